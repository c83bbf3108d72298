#include "collision/edges_near_edges.hpp"

#include "collision/narrow_phase.hpp"

#include <algorithm>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Edge = std::array<Index, 2>;

// A voxel in mean sizes of an edge's box; tried from 0.5 to 3.
constexpr double voxel_per_edge = 1.5;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool have_common_point(const Edge &a, const Edge &b) {
    return a[0] == b[0] || a[0] == b[1] || a[1] == b[0] || a[1] == b[1];
}

Position middle_of(const Extent &box) {
    Position middle;
    for (std::size_t i = 0; i < 3; ++i) // no overflow, and between the two
        middle[i] = box.low[i] + 0.5 * (box.high[i] - box.low[i]);
    return middle;
}

} // namespace

EdgesNearEdges::EdgesNearEdges(std::span<const Position> first_points, std::span<const Edge> first,
                               std::span<const Edge> second, bool is_same_body)
    : _first(first.begin(), first.end()), _second(second.begin(), second.end()),
      _is_same_body(is_same_body) {
    std::vector<double> sizes;
    sizes.reserve(first.size());
    for (const Edge &edge : first)
        sizes.push_back(extent_of(first_points, edge).longest());
    SizeClasses classes = sort_by_size(sizes);
    _class = std::move(classes.of);
    for (std::size_t k = 0; k < classes.count(); ++k) {
        const auto members = static_cast<std::size_t>(
            std::count(_class.begin(), _class.end(), static_cast<std::uint8_t>(k)));
        _classes.push_back({VoxelHash(members), {}, {}, classes.mean[k]});
        _classes.back().active.reserve(members);
        _classes.back().boxes.reserve(members);
    }
    _candidates.reserve(4 * second.size() + 64); // grows, once, where more are found
    _found.reserve(second.size() + 64);
}

void EdgesNearEdges::fill(std::span<const Position> first_points, const Extent &near,
                          double reach) {
    for (SizeClass &one : _classes) {
        one.active.clear();
        one.middles = Extent::nothing();
        one.half = {};
    }
    for (std::size_t e = 0; e < _first.size(); ++e) {
        const Extent box = extent_of(first_points, _first[e]);
        if (!box.meets(near))
            continue;
        SizeClass &one = _classes[_class[e]];
        one.active.push_back(static_cast<Index>(e));
        one.middles.add(middle_of(box));
        for (std::size_t i = 0; i < 3; ++i)
            one.half[i] = std::max(one.half[i], 0.5 * (box.high[i] - box.low[i]));
    }
    for (SizeClass &one : _classes) {
        one.hash.fill(one.active, one.middles, voxel_per_edge * one.size + 2.0 * reach,
                      [&](Index e) { return middle_of(extent_of(first_points, _first[at(e)])); });
        one.boxes.clear();
        for (const VoxelHash::Entry &entry : one.hash.entries())
            one.boxes.push_back(extent_of(first_points, _first[at(entry.id)]));
    }
}

std::span<const EdgesNearEdges::Pair>
EdgesNearEdges::find_candidates(std::span<const Position> first_points,
                                std::span<const Position> second_points, double distance) {
    _candidates.clear();
    const Extent all_first = extent_of_all(first_points);
    const Extent all_second = extent_of_all(second_points);
    const double reach = reach_of(distance, all_second);
    if (!all_second.grown(reach).meets(all_first))
        return _candidates;
    fill(first_points, all_second.grown(reach), reach);
    for (std::size_t e = 0; e < _second.size(); ++e) {
        const Edge &edge = _second[e];
        const Extent box = extent_of(second_points, edge).grown(reach);
        if (!box.meets(all_first))
            continue;
        const std::size_t before = _candidates.size();
        for (const SizeClass &one : _classes) {
            // A box's middle is off by a rounding or two of its coordinates, which the reach of
            // no distance at all is more than.
            const double slack = reach_of(0.0, all_first);
            Extent around = box;
            for (std::size_t i = 0; i < 3; ++i) {
                around.low[i] -= one.half[i] + slack;
                around.high[i] += one.half[i] + slack;
            }
            one.hash.near(around, [&](const VoxelHash::Entry &entry, std::size_t k) {
                if (!one.boxes[k].meets(box))
                    return;
                if (_is_same_body &&
                    (at(entry.id) >= e || have_common_point(_first[at(entry.id)], edge)))
                    return;
                _candidates.push_back({entry.id, static_cast<Index>(e)});
            });
        }
        std::sort(_candidates.begin() + static_cast<std::ptrdiff_t>(before), _candidates.end());
    }
    return _candidates;
}

std::span<const EdgeNearEdge> EdgesNearEdges::find(std::span<const Position> first_points,
                                                   std::span<const Position> second_points,
                                                   double distance) {
    _found.clear();
    for (const auto &[first, second] : find_candidates(first_points, second_points, distance)) {
        EdgeNearEdge pair{first, second, {}, 0.0};
        if (is_near(first_points, _first[at(first)], second_points, _second[at(second)], distance,
                    pair))
            _found.push_back(pair);
    }
    return _found;
}

std::vector<double> EdgesNearEdges::voxel_sizes() const {
    std::vector<double> sizes;
    for (std::size_t k = _classes.size(); k-- > 0;)
        sizes.push_back(voxel_per_edge * _classes[k].size);
    return sizes;
}

bool is_near(std::span<const Position> first_points, const Edge &first,
             std::span<const Position> second_points, const Edge &second, double distance,
             EdgeNearEdge &pair) {
    const NearestOnEdges nearest =
        nearest_on_edges(first_points[at(first[0])], first_points[at(first[1])],
                         second_points[at(second[0])], second_points[at(second[1])]);
    pair.parameters = nearest.parameters;
    pair.distance_squared = nearest.distance_squared;
    return nearest.distance_squared <= distance * distance;
}

std::vector<EdgeNearEdge> find_edges_near_edges_brute_force(std::span<const Position> first_points,
                                                            std::span<const Edge> first,
                                                            std::span<const Position> second_points,
                                                            std::span<const Edge> second,
                                                            double distance, bool is_same_body,
                                                            bool only_candidates) {
    std::vector<EdgeNearEdge> found;
    static_cast<void>(extent_of_all(first_points)); // refused if not finite
    const double reach = reach_of(distance, extent_of_all(second_points));
    for (std::size_t e = 0; e < second.size(); ++e) {
        const Extent box = extent_of(second_points, second[e]).grown(reach);
        for (std::size_t f = 0; f < (is_same_body ? e : first.size()); ++f) {
            if (is_same_body && have_common_point(first[f], second[e]))
                continue;
            EdgeNearEdge pair{static_cast<Index>(f), static_cast<Index>(e), {}, 0.0};
            const bool is_candidate = box.meets(extent_of(first_points, first[f]));
            const bool is_within =
                is_near(first_points, first[f], second_points, second[e], distance, pair);
            if (only_candidates ? is_candidate : is_within)
                found.push_back(pair);
        }
    }
    return found;
}

} // namespace fastsim
