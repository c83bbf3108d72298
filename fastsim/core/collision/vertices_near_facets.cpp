#include "collision/vertices_near_facets.hpp"

#include "collision/narrow_phase.hpp"

#include <algorithm>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Facet = std::array<Index, 3>;

// A voxel in mean sizes of a facet's box; tried from 0.5 to 2.
constexpr double voxel_per_facet = 1.0;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool is_corner(Index vertex, const Facet &facet) {
    return vertex == facet[0] || vertex == facet[1] || vertex == facet[2];
}

} // namespace

VerticesNearFacets::VerticesNearFacets(std::span<const Position> facet_points,
                                       std::span<const Facet> facets,
                                       std::span<const Index> vertices, bool is_same_body)
    : _vertices(vertices.begin(), vertices.end()), _facets(facets.begin(), facets.end()),
      _is_same_body(is_same_body) {
    std::vector<double> sizes;
    sizes.reserve(facets.size());
    for (const Facet &facet : facets)
        sizes.push_back(extent_of(facet_points, facet).longest());
    _classes = sort_by_size(sizes);
    for (std::size_t k = 0; k < _classes.count(); ++k)
        _hash.emplace_back(vertices.size());
    _is_filled.resize(_classes.count());
    _active.reserve(vertices.size());
    _candidates.reserve(facets.size() + 64); // grows, once, where more are found
    _found.reserve(facets.size() + 64);
}

std::span<const VerticesNearFacets::Pair>
VerticesNearFacets::find_candidates(std::span<const Position> vertex_points,
                                    std::span<const Position> facet_points, double distance) {
    _candidates.clear();
    // Only vertices in the box of all facets count, and only facets that meet the box of those.
    const Extent all = extent_of_all(facet_points);
    const double reach = reach_of(distance, all);
    const Extent body = all.grown(reach);
    if (!extent_of_some(vertex_points, _vertices).meets(body))
        return _candidates;
    _active.clear();
    Extent near = Extent::nothing();
    for (const Index v : _vertices)
        if (const Position &p = vertex_points[at(v)]; body.contains(p)) {
            _active.push_back(v);
            near.add(p);
        }
    std::fill(_is_filled.begin(), _is_filled.end(), std::uint8_t{0});
    for (std::size_t f = 0; f < _facets.size(); ++f) {
        const Facet &facet = _facets[f];
        const Extent box = extent_of(facet_points, facet).grown(reach);
        if (!box.meets(near))
            continue;
        const std::size_t k = _classes.of[f];
        if (!_is_filled[k]) {
            _is_filled[k] = 1;
            _hash[k].fill(_active, near, voxel_per_facet * _classes.mean[k] + 2.0 * reach,
                          [&](Index v) -> const Position & { return vertex_points[at(v)]; });
        }
        const std::size_t before = _candidates.size();
        _hash[k].near(box, [&](const VoxelHash::Entry &entry, std::size_t) {
            if (!_is_same_body || !is_corner(entry.id, facet))
                _candidates.push_back({entry.id, static_cast<Index>(f)});
        });
        std::sort(_candidates.begin() + static_cast<std::ptrdiff_t>(before), _candidates.end());
    }
    return _candidates;
}

std::span<const VertexNearFacet> VerticesNearFacets::find(std::span<const Position> vertex_points,
                                                          std::span<const Position> facet_points,
                                                          double distance) {
    _found.clear();
    for (const auto &[vertex, facet] : find_candidates(vertex_points, facet_points, distance)) {
        VertexNearFacet pair{vertex, facet, {}, 0.0};
        if (is_near(vertex_points, facet_points, _facets[at(facet)], distance, pair))
            _found.push_back(pair);
    }
    return _found;
}

std::vector<double> VerticesNearFacets::voxel_sizes() const {
    std::vector<double> sizes;
    for (std::size_t k = _classes.count(); k-- > 0;)
        sizes.push_back(voxel_per_facet * _classes.mean[k]);
    return sizes;
}

bool is_near(std::span<const Position> vertex_points, std::span<const Position> facet_points,
             const Facet &facet, double distance, VertexNearFacet &pair) {
    const NearestOnFacet nearest =
        nearest_on_facet(vertex_points[at(pair.vertex)], facet_points[at(facet[0])],
                         facet_points[at(facet[1])], facet_points[at(facet[2])]);
    pair.weights = nearest.weights;
    pair.distance_squared = nearest.distance_squared;
    return nearest.distance_squared <= distance * distance;
}

std::vector<VertexNearFacet> find_vertices_near_facets_brute_force(
    std::span<const Position> vertex_points, std::span<const Index> vertices,
    std::span<const Position> facet_points, std::span<const Facet> facets, double distance,
    bool is_same_body, bool only_candidates) {
    std::vector<VertexNearFacet> found;
    static_cast<void>(extent_of_some(vertex_points, vertices)); // refused if not finite
    const double reach = reach_of(distance, extent_of_all(facet_points));
    for (std::size_t f = 0; f < facets.size(); ++f) {
        const Extent box = extent_of(facet_points, facets[f]).grown(reach);
        const std::size_t before = found.size();
        for (const Index v : vertices) {
            if (is_same_body && is_corner(v, facets[f]))
                continue;
            VertexNearFacet pair{v, static_cast<Index>(f), {}, 0.0};
            const bool is_candidate = box.contains(vertex_points[at(v)]);
            const bool is_within = is_near(vertex_points, facet_points, facets[f], distance, pair);
            if (only_candidates ? is_candidate : is_within)
                found.push_back(pair);
        }
        std::sort(found.begin() + static_cast<std::ptrdiff_t>(before), found.end(),
                  [](const auto &x, const auto &y) { return x.vertex < y.vertex; });
    }
    return found;
}

} // namespace fastsim
