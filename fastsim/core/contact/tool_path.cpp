#include "contact/tool_path.hpp"

#include <algorithm>
#include <cmath>

namespace fastsim {

ToolPath::ToolPath(std::span<const double> times, std::span<const Point> positions,
                   std::span<const Quaternion> rotations)
    : _times(times.begin(), times.end()), _positions(positions.begin(), positions.end()),
      _rotations(rotations.begin(), rotations.end()) {}

std::pair<std::size_t, double> ToolPath::place_of(double time) const {
    const auto after = std::ranges::upper_bound(_times, time);
    if (after == _times.begin())
        return {0, 0.0};
    const auto knot = static_cast<std::size_t>(after - _times.begin()) - 1;
    return {knot, after == _times.end() ? 0.0 : time - _times[knot]};
}

Quaternion ToolPath::rotation_at(double time) const {
    const auto [knot, since] = place_of(time);
    if (since == 0.0 || _rotations[knot] == _rotations[knot + 1])
        return _rotations[knot];
    const double s = since / (_times[knot + 1] - _times[knot]);
    const Quaternion &start = _rotations[knot], &end = _rotations[knot + 1];
    double cosine = 0.0;
    for (std::size_t k = 0; k < 4; ++k)
        cosine += start[k] * end[k];
    // The shorter way round: q and -q are the same rotation.
    const double sign = cosine < 0.0 ? -1.0 : 1.0;
    const double angle = std::acos(std::min(std::abs(cosine), 1.0));
    double first = 1.0 - s, last = s;
    if (!(angle < 1e-9)) {
        first = std::sin((1.0 - s) * angle) / std::sin(angle);
        last = std::sin(s * angle) / std::sin(angle);
    }
    Quaternion between{};
    for (std::size_t k = 0; k < 4; ++k)
        between[k] = first * start[k] + last * (sign * end[k]);
    return between;
}

ToolPath ToolPath::way_to(const Point &position, const std::optional<Quaternion> &rotation,
                          double begin, double end) const {
    const Quaternion turned = rotation_at(begin);
    return ToolPath(std::array{begin, end}, std::array{pose_at(begin).position, position},
                    std::array{turned, rotation.value_or(turned)});
}

double ToolPath::fastest_point(double reach) const {
    double fastest = 0.0;
    for (std::size_t k = 1; k < _times.size(); ++k) {
        double squared = 0.0, cosine = 0.0;
        for (std::size_t j = 0; j < 3; ++j)
            squared += std::pow(_positions[k][j] - _positions[k - 1][j], 2);
        for (std::size_t j = 0; j < 4; ++j)
            cosine += _rotations[k][j] * _rotations[k - 1][j];
        const double turn = 2.0 * std::acos(std::min(std::abs(cosine), 1.0));
        const double way = std::sqrt(squared) + (std::isfinite(reach) ? turn * reach : 0.0);
        fastest = std::max(fastest, way / (_times[k] - _times[k - 1]));
    }
    return fastest;
}

Pose ToolPath::pose_at(double time) const {
    const auto [knot, since] = place_of(time);
    Pose pose{_positions[knot], {}};
    if (since != 0.0)
        for (std::size_t j = 0; j < 3; ++j) {
            const double slope =
                (_positions[knot + 1][j] - _positions[knot][j]) / (_times[knot + 1] - _times[knot]);
            pose.position[j] = slope * since + _positions[knot][j];
        }
    const auto [w, x, y, z] = rotation_at(time);
    pose.rotation = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                     2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    return pose;
}

} // namespace fastsim
