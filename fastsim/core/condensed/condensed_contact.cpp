#include "condensed/condensed_contact.hpp"

#include "condensed/small_system.hpp"
#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace fastsim {

namespace {

constexpr int most_rounds = 20;
// Part of the largest displacement: with less wrong, pushes are nearly what they will be.
constexpr double nearly = 0.05;
// Of a step's way that is tried.
constexpr double smallest_part = 1.0 / 64.0;

bool is_in(const Box &box, const Point &place) {
    return place[0] >= box.low[0] && place[0] <= box.high[0] && place[1] >= box.low[1] &&
           place[1] <= box.high[1] && place[2] >= box.low[2] && place[2] <= box.high[2];
}

Point times(const CompliancePart &c, const Point &f) {
    return {c[0] * f[0] + c[1] * f[1] + c[2] * f[2], c[3] * f[0] + c[4] * f[1] + c[5] * f[2],
            c[6] * f[0] + c[7] * f[1] + c[8] * f[2]};
}

CompliancePart product(const CompliancePart &a, const CompliancePart &b) {
    CompliancePart c{};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
    return c;
}

/// Poses a part of the way from some to others.
std::vector<Pose> between(std::span<const Pose> from, std::span<const Pose> to, double part) {
    std::vector<Pose> poses(to.begin(), to.end());
    for (std::size_t k = 0; k < poses.size(); ++k) {
        for (std::size_t a = 0; a < 3; ++a)
            poses[k].position[a] += (1.0 - part) * (from[k].position[a] - to[k].position[a]);
        // Columns of the mean, made orthonormal again.
        std::array<Point, 3> axes{};
        for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i)
                axes[j][i] =
                    (1.0 - part) * from[k].rotation[3 * i + j] + part * to[k].rotation[3 * i + j];
        axes[0] = along({}, axes[0], 1.0 / norm(axes[0]));
        axes[1] = along(axes[1], axes[0], -dot(axes[0], axes[1]));
        axes[1] = along({}, axes[1], 1.0 / norm(axes[1]));
        axes[2] = cross(axes[0], axes[1]);
        for (std::size_t j = 0; j < 3; ++j)
            for (std::size_t i = 0; i < 3; ++i)
                poses[k].rotation[3 * i + j] = axes[j][i];
    }
    return poses;
}

std::variant<ResponseColumns<float>, ResponseColumns<double>>
columns_of(const Compliance &compliance) {
    if (compliance.is_single())
        return ResponseColumns<float>(compliance);
    return ResponseColumns<double>(compliance);
}

double largest(const Point &v) {
    return std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])});
}

} // namespace

CondensedContact::CondensedContact(Compliance compliance, std::vector<Point> places,
                                   std::vector<CondensedTool> tools, bool is_penalty, double reach)
    : _compliance(compliance), _all_columns(columns_of(compliance)), _places(std::move(places)),
      _tools(std::move(tools)), _is_penalty(is_penalty), _reach(reach),
      _response(compliance.num_seen()), _forces(compliance.num_touched()), _loads(_tools.size()),
      _local(compliance.num_touched(), -1) {
    for (const CondensedTool &tool : _tools) {
        _boxes.push_back(box_of(tool.shape));
        _pushes.emplace_back(tool.areas.size(), 0.0);
        auto &patches = _patches_of.emplace_back(tool.areas.size());
        for (std::size_t at = 0; at < tool.constraints.size(); ++at)
            if (tool.constraints[at] >= 0)
                patches[static_cast<std::size_t>(tool.constraints[at])].push_back(
                    static_cast<std::int32_t>(at / tool.num_own));
    }
}

void CondensedContact::clear() {
    for (std::vector<double> &pushes : _pushes)
        std::ranges::fill(pushes, 0.0);
    std::ranges::fill(_response, Point{});
    std::ranges::fill(_forces, Point{});
    std::ranges::fill(_loads, ToolLoad{});
    _last.clear();
}

Point CondensedContact::place_of(std::size_t touched, std::span<const Point> base) const {
    const std::size_t seen = _compliance.num_only_seen() + touched;
    return along(along(_places[touched], base[seen], 1.0), _response[seen], 1.0);
}

/// Where the corners of a patch are by the last response.
std::array<Point, 3> CondensedContact::corners_of(std::size_t tool, std::size_t patch,
                                                  std::span<const Point> base) const {
    const CondensedTool &of = _tools[tool];
    std::array<Point, 3> corners{};
    for (std::size_t k = 0; k < of.num_corners; ++k) {
        const std::size_t at = patch * of.num_corners + k;
        corners[k] = of.corners[at] < 0 ? of.rest[at]
                                        : place_of(static_cast<std::size_t>(of.corners[at]), base);
    }
    return corners;
}

Point CondensedContact::place_in(const Patch &patch, std::size_t point,
                                 const std::array<Point, 3> &corners) const {
    const CondensedTool &tool = _tools[patch.tool];
    Point place{};
    for (std::size_t k = 0; k < tool.num_corners; ++k)
        place = along(place, corners[k], tool.shape_functions[point * tool.num_corners + k]);
    return place;
}

double CondensedContact::share_of(const Patch &patch, std::size_t point, std::size_t own) const {
    const CondensedTool &tool = _tools[patch.tool];
    return tool.shares[(patch.number * tool.num_points + point) * tool.num_own + own];
}

/// The force on a point of a patch, along the normal there.
double CondensedContact::push_at(const Patch &patch, std::size_t point, double Entry::*push) const {
    double sum = 0.0;
    for (std::size_t c = 0; c < _tools[patch.tool].num_own; ++c)
        if (const std::int32_t entry = _owns[patch.first_own + c].entry; entry >= 0)
            sum += share_of(patch, point, c) * (_entries[static_cast<std::size_t>(entry)].*push);
    return sum;
}

double CondensedContact::gap_of_constraint(std::size_t tool, std::size_t constraint,
                                           std::span<const Pose> poses,
                                           std::span<const Point> base) const {
    const CondensedTool &of = _tools[tool];
    double gap = 0.0;
    for (const std::int32_t number : _patches_of[tool][constraint]) {
        const Patch patch{tool, static_cast<std::size_t>(number)};
        const std::array<Point, 3> corners = corners_of(tool, patch.number, base);
        for (std::size_t c = 0; c < of.num_own; ++c) {
            if (of.constraints[patch.number * of.num_own + c] !=
                static_cast<std::int32_t>(constraint))
                continue;
            for (std::size_t q = 0; q < of.num_points; ++q)
                if (const double share = share_of(patch, q, c); share != 0.0)
                    gap +=
                        share * gap_at(of.shape, poses[tool], place_in(patch, q, corners)).distance;
        }
    }
    return gap;
}

/// Adds what is pushed or nearer than the margin, as displaced by the last pushes, and says whether
/// there was any that was not looked at yet.
bool CondensedContact::add_near(std::span<const Pose> poses, std::span<const Point> base,
                                double margin) {
    const std::size_t before = _entries.size(), first = _compliance.num_only_seen();
    const std::span<const Point> places = _places, before_it = base.subspan(first),
                                 by_it = std::span<const Point>(_response).subspan(first);
    for (std::size_t t = 0; t < _tools.size(); ++t) {
        const CondensedTool &tool = _tools[t];
        const Box box = posed_box(_boxes[t], poses[t], margin + tool.spread);
        const std::span<const double> pushes = _pushes[t];
        const std::span<const std::int32_t> centres = tool.centres;
        for (std::size_t i = 0; i < pushes.size(); ++i) {
            const double push = pushes[i];
            if (push <= 0.0) {
                // Most are far away along the first axis already.
                const auto centre = static_cast<std::size_t>(centres[i]);
                const double x = places[centre][0] + before_it[centre][0] + by_it[centre][0];
                if (x < box.low[0] || x > box.high[0])
                    continue;
                if (!is_in(box, place_of(centre, base)) ||
                    gap_of_constraint(t, i, poses, base) >= margin)
                    continue;
            }
            const auto is_it = [&](const Entry &e) { return e.tool == t && e.constraint == i; };
            if (std::any_of(_entries.begin(),
                            _entries.begin() + static_cast<std::ptrdiff_t>(before), is_it))
                continue;
            const double give = _is_penalty ? 1.0 / (tool.stiffness * tool.areas[i]) : 0.0;
            _entries.push_back({t, i, give, push, push});
        }
    }
    if (_entries.size() == before)
        return false;
    gather_patches();
    return true;
}

/// The patches of all entries, their corners, and of each entry the points that its gap depends on.
void CondensedContact::gather_patches() {
    _patches.clear();
    _owns.clear();
    _gaps.clear();
    for (std::size_t e = 0; e < _entries.size(); ++e) {
        Entry &entry = _entries[e];
        entry.points.clear();
        const CondensedTool &tool = _tools[entry.tool];
        for (const std::int32_t number : _patches_of[entry.tool][entry.constraint]) {
            const auto is_it = [&](const Patch &p) {
                return p.tool == entry.tool && p.number == static_cast<std::size_t>(number);
            };
            auto patch = std::ranges::find_if(_patches, is_it);
            if (patch == _patches.end()) {
                _patches.push_back({entry.tool, static_cast<std::size_t>(number)});
                patch = _patches.end() - 1;
                patch->first_own = _owns.size();
                patch->first_gap = _gaps.size();
                _owns.resize(_owns.size() + tool.num_own);
                _gaps.resize(_gaps.size() + tool.num_points, Gap{0.0, {}});
                for (std::size_t k = 0; k < tool.num_corners; ++k) {
                    const std::int32_t touched = tool.corners[patch->number * tool.num_corners + k];
                    if (touched < 0)
                        continue;
                    std::int32_t &local = _local[static_cast<std::size_t>(touched)];
                    if (local < 0) {
                        local = static_cast<std::int32_t>(_points.size());
                        _points.push_back(touched);
                    }
                    patch->corners[k] = local;
                }
            }
            for (std::size_t c = 0; c < tool.num_own; ++c) {
                if (tool.constraints[patch->number * tool.num_own + c] !=
                    static_cast<std::int32_t>(entry.constraint))
                    continue;
                Own &own = _owns[patch->first_own + c];
                own.entry = static_cast<std::int32_t>(e);
                for (std::size_t k = 0; k < tool.num_corners; ++k) {
                    if (patch->corners[k] < 0)
                        continue;
                    const auto point = static_cast<std::size_t>(patch->corners[k]);
                    const auto at = std::ranges::find(entry.points, point);
                    own.slots[k] = static_cast<std::int32_t>(at - entry.points.begin());
                    if (at == entry.points.end())
                        entry.points.push_back(point);
                }
            }
        }
        entry.gradient.resize(entry.points.size());
    }
}

void CondensedContact::gather_parts() {
    if (_gathered == _points)
        return;
    const std::size_t n = _points.size();
    _parts.resize(n * n);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j)
            _parts[i * n + j] = _compliance.part(static_cast<std::size_t>(_points[i]),
                                                 static_cast<std::size_t>(_points[j]));
    _gathered = _points;
}

ContactOutcome CondensedContact::step(std::span<const Pose> poses, std::span<const Point> base,
                                      double relative_tolerance, int max_iterations) {
    const auto pushes = _pushes;
    const auto response = _response, forces = _forces;
    const auto loads = _loads;
    const auto last = _last;
    ContactOutcome outcome;
    double reached = 0.0, part = 1.0;
    while (reached < 1.0) {
        const double target = std::min(1.0, reached + part);
        const std::vector<Pose> on_way = target < 1.0
                                             ? between(last, poses, target)
                                             : std::vector<Pose>(poses.begin(), poses.end());
        const ContactOutcome found = go_to(on_way, base, relative_tolerance, max_iterations);
        outcome = {found.is_settled, outcome.iterations + found.iterations, found.touching,
                   found.error};
        if (found.is_settled) {
            reached = target;
            _last = on_way;
            continue;
        }
        part *= 0.5;
        if (last.empty() || part < smallest_part) {
            _pushes = pushes;
            _response = response;
            _forces = forces;
            _loads = loads;
            _last = last;
            return outcome;
        }
    }
    return outcome;
}

ContactOutcome CondensedContact::go_to(std::span<const Pose> poses, std::span<const Point> base,
                                       double relative_tolerance, int max_iterations) {
    _entries.clear();
    _patches.clear();
    _points.clear();
    std::ranges::fill(_local, -1);
    ContactOutcome outcome;
    add_near(poses, base, _reach);
    for (int round = 0; round < most_rounds; ++round) {
        const ContactOutcome found = settle(poses, base, relative_tolerance, max_iterations);
        outcome.iterations += found.iterations;
        outcome.error = found.error;
        if (!found.is_settled)
            return outcome;
        take_over(poses, base);
        if (!add_near(poses, base, 0.0)) {
            outcome.is_settled = true;
            break;
        }
    }
    for (const Entry &entry : _entries)
        outcome.touching += entry.push > 0.0 ? 1 : 0;
    return outcome;
}

ContactOutcome CondensedContact::settle(std::span<const Pose> poses, std::span<const Point> base,
                                        double relative_tolerance, int max_iterations) {
    gather_parts();
    const std::size_t n = _points.size(), first = _compliance.num_only_seen();
    const auto touched = [&](std::size_t local) {
        return static_cast<std::size_t>(_points[local]);
    };
    _moved.resize(n);
    _pushed.resize(n);
    for (std::size_t p = 0; p < n; ++p)
        _moved[p] = along(base[first + touched(p)], _response[first + touched(p)], 1.0);
    std::vector<Point> residual(n);
    ContactOutcome outcome;
    for (; outcome.iterations < max_iterations; ++outcome.iterations) {
        const double place_size = measure(poses);
        double size = 0.0, error = 0.0;
        for (const Entry &entry : _entries) {
            const double wrong = entry.gap + entry.give * entry.push;
            error = std::max(error, entry.push > 0.0 ? std::abs(wrong) : -wrong);
        }
        for (std::size_t p = 0; p < n; ++p) {
            Point sum = base[first + touched(p)];
            for (std::size_t q = 0; q < n; ++q)
                if (_pushed[q] != Point{})
                    sum = along(sum, times(_parts[p * n + q], _pushed[q]), 1.0);
            residual[p] = minus(sum, _moved[p]);
            size = std::max(size, largest(sum));
            error = std::max(error, largest(residual[p]));
        }
        outcome.error = error;
        if (!std::isfinite(error))
            return outcome;
        constexpr double eps = std::numeric_limits<double>::epsilon();
        if (error <= std::max(relative_tolerance * size, 16.0 * eps * place_size)) {
            outcome.is_settled = true;
            return outcome;
        }
        // On the way pushes may be far too large, and the body give way under their turning.
        for (Entry &entry : _entries)
            entry.settled =
                error < nearly * size ? entry.push : std::min(entry.settled, entry.push);
        if (!change(residual))
            return outcome;
    }
    return outcome;
}

/// Gaps, their gradients, and the forces of the pushes where the points are; the largest coordinate
/// of a place.
double CondensedContact::measure(std::span<const Pose> poses) {
    std::ranges::fill(_pushed, Point{});
    for (Entry &entry : _entries) {
        entry.gap = 0.0;
        std::ranges::fill(entry.gradient, Point{});
    }
    double place_size = 0.0;
    for (Patch &patch : _patches) {
        const CondensedTool &tool = _tools[patch.tool];
        std::array<Point, 3> corners{};
        for (std::size_t k = 0; k < tool.num_corners; ++k) {
            corners[k] = tool.rest[patch.number * tool.num_corners + k];
            if (patch.corners[k] >= 0)
                corners[k] =
                    along(corners[k], _moved[static_cast<std::size_t>(patch.corners[k])], 1.0);
            place_size = std::max(place_size, largest(corners[k]));
        }
        for (std::size_t q = 0; q < tool.num_points; ++q) {
            const Gap gap = gap_at(tool.shape, poses[patch.tool], place_in(patch, q, corners));
            _gaps[patch.first_gap + q] = gap;
            const double *parts = &tool.shape_functions[q * tool.num_corners];
            double push = 0.0;
            for (std::size_t c = 0; c < tool.num_own; ++c) {
                const double share = share_of(patch, q, c);
                const Own &own = _owns[patch.first_own + c];
                if (own.entry < 0 || share == 0.0)
                    continue;
                Entry &entry = _entries[static_cast<std::size_t>(own.entry)];
                entry.gap += share * gap.distance;
                push += share * entry.push;
                for (std::size_t k = 0; k < tool.num_corners; ++k)
                    if (patch.corners[k] >= 0) {
                        Point &gradient = entry.gradient[static_cast<std::size_t>(own.slots[k])];
                        gradient = along(gradient, gap.normal, share * parts[k]);
                    }
            }
            for (std::size_t k = 0; push != 0.0 && k < tool.num_corners; ++k)
                if (patch.corners[k] >= 0) {
                    Point &force = _pushed[static_cast<std::size_t>(patch.corners[k])];
                    force = along(force, gap.normal, push * parts[k]);
                }
        }
    }
    return place_size;
}

/// Which points feel normals turn under pushes, and how: D, the sum over the points of patches of
/// their push times kappa (I - n n^T - axis axis^T), between the corners of each.
void CondensedContact::turn_normals() {
    _bent.clear();
    std::vector<std::size_t> row_of(_points.size(), _points.size());
    for (const Patch &patch : _patches) {
        const CondensedTool &tool = _tools[patch.tool];
        for (std::size_t q = 0; q < tool.num_points; ++q) {
            const Gap &gap = _gaps[patch.first_gap + q];
            const double bend =
                gap.curvature == 0.0 ? 0.0 : push_at(patch, q, &Entry::settled) * gap.curvature;
            if (bend == 0.0)
                continue;
            CompliancePart d{};
            for (std::size_t a = 0; a < 3; ++a)
                for (std::size_t b = 0; b < 3; ++b)
                    d[3 * a + b] = bend * ((a == b ? 1.0 : 0.0) - gap.normal[a] * gap.normal[b] -
                                           gap.axis[a] * gap.axis[b]);
            const double *parts = &tool.shape_functions[q * tool.num_corners];
            std::array<std::size_t, 3> rows{};
            for (std::size_t k = 0; k < tool.num_corners; ++k) {
                if (patch.corners[k] < 0)
                    continue;
                std::size_t &row = row_of[static_cast<std::size_t>(patch.corners[k])];
                if (row == _points.size()) {
                    row = _bent.size();
                    _bent.push_back(static_cast<std::size_t>(patch.corners[k]));
                    if (row == _turning.size())
                        _turning.emplace_back();
                    _turning[row].clear();
                }
                rows[k] = row;
            }
            for (std::size_t k = 0; k < tool.num_corners; ++k)
                for (std::size_t l = 0; l < tool.num_corners; ++l)
                    if (patch.corners[k] >= 0 && patch.corners[l] >= 0)
                        add_part(_turning[rows[l]], rows[k], parts[k] * parts[l], d);
        }
    }
}

void CondensedContact::add_part(std::vector<Turned> &column, std::size_t row, double factor,
                                const CompliancePart &part) {
    auto at = std::ranges::find(column, row, &Turned::row);
    if (at == column.end()) {
        column.push_back({row, {}});
        at = column.end() - 1;
    }
    for (std::size_t a = 0; a < 9; ++a)
        at->part[a] += factor * part[a];
}

/// One Newton step: du = C (G dp + D du) + r, and g + grad g . du + p / (k A) complementary to p.
bool CondensedContact::change(std::span<const Point> residual) {
    turn_normals();
    const std::size_t n = _points.size(), m = _entries.size(), width = m + 1;
    // Columns of du without the turning of normals: of each dp, and of r.
    _columns.resize(3 * n * width);
    for (std::size_t p = 0; p < n; ++p) {
        double *rows = &_columns[3 * p * width];
        for (std::size_t f = 0; f < m; ++f) {
            const Entry &entry = _entries[f];
            Point moved{};
            for (std::size_t r = 0; r < entry.points.size(); ++r)
                moved =
                    along(moved, times(_parts[p * n + entry.points[r]], entry.gradient[r]), 1.0);
            for (std::size_t a = 0; a < 3; ++a)
                rows[a * width + f] = moved[a];
        }
        for (std::size_t a = 0; a < 3; ++a)
            rows[a * width + m] = residual[p][a];
    }
    // At points whose normals turn (I - C D) du is what these say; C D du is the same elsewhere.
    const std::size_t bent = _bent.size(), size = 3 * bent;
    _matrix.resize(size * size);
    _bent_columns.resize(size * width);
    _response_parts.assign(n * bent, {});
    for (std::size_t p = 0; p < n; ++p)
        for (std::size_t j = 0; j < bent; ++j)
            for (const Turned &turned : _turning[j]) {
                const CompliancePart cd = product(_parts[p * n + _bent[turned.row]], turned.part);
                for (std::size_t a = 0; a < 9; ++a)
                    _response_parts[p * bent + j][a] += cd[a];
            }
    for (std::size_t i = 0; i < bent; ++i) {
        std::copy_n(&_columns[3 * _bent[i] * width], 3 * width, &_bent_columns[3 * i * width]);
        for (std::size_t j = 0; j < bent; ++j) {
            const CompliancePart &cd = _response_parts[_bent[i] * bent + j];
            for (std::size_t a = 0; a < 3; ++a)
                for (std::size_t b = 0; b < 3; ++b)
                    _matrix[(3 * i + a) * size + 3 * j + b] =
                        (i == j && a == b ? 1.0 : 0.0) - cd[3 * a + b];
        }
    }
    if (!solve_small(_matrix, _bent_columns, size, width))
        return false;
    // Along the gradients: g + grad g . du.
    _small.resize(m * m);
    _slack.resize(m);
    _push.resize(m);
    std::vector<double> row(width);
    for (std::size_t e = 0; e < m; ++e) {
        const Entry &entry = _entries[e];
        std::ranges::fill(row, 0.0);
        const auto add = [&](double factor, const double *from) {
            for (std::size_t f = 0; f < width; ++f)
                row[f] += factor * from[f];
        };
        for (std::size_t r = 0; r < entry.points.size(); ++r) {
            const Point &g = entry.gradient[r];
            for (std::size_t a = 0; a < 3; ++a)
                add(g[a], &_columns[(3 * entry.points[r] + a) * width]);
            for (std::size_t j = 0; j < bent; ++j) {
                const CompliancePart &cd = _response_parts[entry.points[r] * bent + j];
                for (std::size_t b = 0; b < 3; ++b)
                    add(g[0] * cd[b] + g[1] * cd[3 + b] + g[2] * cd[6 + b],
                        &_bent_columns[(3 * j + b) * width]);
            }
        }
        _slack[e] = entry.gap + row[m];
        for (std::size_t f = 0; f < m; ++f) {
            _small[e * m + f] = row[f];
            _slack[e] -= row[f] * _entries[f].push;
        }
        _small[e * m + e] += entry.give;
        _push[e] = entry.push;
    }
    if (!_complementarity.solve(_small, _slack, _push))
        return false;
    std::vector<double> change(width, 1.0); // of the pushes, and once r
    for (std::size_t e = 0; e < m; ++e) {
        change[e] = _push[e] - _entries[e].push;
        _entries[e].push = _push[e];
    }
    const auto sum = [&](const double *from) {
        return std::inner_product(change.begin(), change.end(), from, 0.0);
    };
    std::vector<Point> turned(bent); // D du
    for (std::size_t j = 0; j < bent; ++j) {
        Point moved{};
        for (std::size_t a = 0; a < 3; ++a)
            moved[a] = sum(&_bent_columns[(3 * j + a) * width]);
        for (const Turned &part : _turning[j])
            turned[part.row] = along(turned[part.row], times(part.part, moved), 1.0);
    }
    for (std::size_t p = 0; p < n; ++p) {
        for (std::size_t a = 0; a < 3; ++a)
            _moved[p][a] += sum(&_columns[(3 * p + a) * width]);
        for (std::size_t j = 0; j < bent; ++j)
            _moved[p] = along(_moved[p], times(_parts[p * n + _bent[j]], turned[j]), 1.0);
    }
    return true;
}

/// Pushes, forces and displacements of what has settled.
void CondensedContact::take_over(std::span<const Pose> poses, std::span<const Point> base) {
    std::ranges::fill(_forces, Point{});
    std::ranges::fill(_loads, ToolLoad{});
    for (const Entry &entry : _entries)
        _pushes[entry.tool][entry.constraint] = entry.push;
    for (std::size_t p = 0; p < _points.size(); ++p)
        _forces[static_cast<std::size_t>(_points[p])] = _pushed[p];
    std::visit([&](auto &columns) { columns.respond(_forces, _points, _response); }, _all_columns);
    for (const Patch &patch : _patches) {
        const std::array<Point, 3> corners = corners_of(patch.tool, patch.number, base);
        ToolLoad &load = _loads[patch.tool];
        for (std::size_t q = 0; q < _tools[patch.tool].num_points; ++q) {
            const double push = push_at(patch, q, &Entry::push);
            if (push == 0.0)
                continue;
            const Point force = along({}, _gaps[patch.first_gap + q].normal, -push);
            const Point arm = minus(place_in(patch, q, corners), poses[patch.tool].position);
            load.force = along(load.force, force, 1.0);
            load.moment = along(load.moment, cross(arm, force), 1.0);
        }
    }
}

} // namespace fastsim
