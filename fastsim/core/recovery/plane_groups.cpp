#include "recovery/plane_groups.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <numeric>

namespace fastsim {

namespace {

// Height over longest edge.
constexpr double needle = 0.1;
// Of the longest edge of the largest facet: roundings of coordinates.
constexpr double flatness = 1e-12;

} // namespace

std::vector<PlaneGroup> find_needle_planes(std::span<const Point> points,
                                           std::span<const Triple> facets) {
    const auto place = [&](Index i) -> const Point & { return points[TetComplex::at(i)]; };
    const auto normal_of = [&](const Triple &f) {
        return cross(minus(place(f[1]), place(f[0])), minus(place(f[2]), place(f[0])));
    };
    std::vector<double> areas(facets.size()), lengths(facets.size(), 0.0);
    const auto is_needle = [&](std::size_t i) {
        return areas[i] < needle * lengths[i] * lengths[i];
    };
    bool has_needles = false;
    for (std::size_t i = 0; i < facets.size(); ++i) {
        const Triple &f = facets[i];
        areas[i] = norm(normal_of(f));
        for (std::size_t k = 0; k < 3; ++k)
            lengths[i] = std::max(lengths[i], norm(minus(place(f[(k + 1) % 3]), place(f[k]))));
        has_needles = has_needles || is_needle(i);
    }
    if (!has_needles)
        return {};
    std::unordered_map<std::uint64_t, std::array<Index, 2>> sides;
    for (std::size_t i = 0; i < facets.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k) {
            const Index a = facets[i][k], b = facets[i][(k + 1) % 3];
            sides.try_emplace(edge_key(a, b), std::array{none, none}).first->second[a < b ? 0 : 1] =
                static_cast<Index>(i);
        }
    std::vector<Index> by_area(facets.size());
    std::iota(by_area.begin(), by_area.end(), 0);
    std::stable_sort(by_area.begin(), by_area.end(), [&](Index i, Index j) {
        return areas[TetComplex::at(i)] > areas[TetComplex::at(j)];
    });
    std::vector<PlaneGroup> groups;
    std::vector<char> is_taken(facets.size(), 0);
    for (const Index first : by_area) {
        const std::size_t start = TetComplex::at(first);
        if (is_taken[start] || !(areas[start] > 0.0))
            continue;
        is_taken[start] = 1;
        PlaneGroup group{normal_of(facets[start]), {}};
        const Point &origin = place(facets[start][0]);
        const double most = flatness * lengths[start] * areas[start];
        bool has_needle = false;
        std::vector<std::size_t> found{start};
        for (std::size_t i = 0; i < found.size(); ++i) {
            const Triple &f = facets[found[i]];
            has_needle = has_needle || is_needle(found[i]);
            group.facets.push_back(f);
            for (std::size_t k = 0; k < 3; ++k) {
                const Index a = f[k], b = f[(k + 1) % 3];
                const Index next = sides.at(edge_key(a, b))[a < b ? 1 : 0];
                if (next == none || is_taken[TetComplex::at(next)])
                    continue;
                const Triple &g = facets[TetComplex::at(next)];
                if (!(dot(normal_of(g), group.normal) > 0.0) ||
                    !std::all_of(g.begin(), g.end(), [&](Index v) {
                        return std::abs(dot(group.normal, minus(place(v), origin))) <= most;
                    }))
                    continue;
                is_taken[TetComplex::at(next)] = 1;
                found.push_back(TetComplex::at(next));
            }
        }
        if (has_needle && group.facets.size() > 2)
            groups.push_back(std::move(group));
    }
    return groups;
}

} // namespace fastsim
