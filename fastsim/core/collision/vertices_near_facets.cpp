#include "collision/vertices_near_facets.hpp"

#include "collision/narrow_phase.hpp"

namespace fastsim {

namespace {

using Index = std::int32_t;
using Facet = std::array<Index, 3>;

// Tried on bodies of 5 000 to 50 000 facets, from 16 to 64, and from 0.25 to 1 block.
constexpr std::size_t facets_in_block = 32;
constexpr double voxel_per_block = 0.5;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool is_corner(Index vertex, const Facet &facet) {
    return vertex == facet[0] || vertex == facet[1] || vertex == facet[2];
}

} // namespace

VerticesNearFacets::VerticesNearFacets(std::span<const Position> facet_points,
                                       std::span<const Facet> facets,
                                       std::span<const Index> vertices, bool is_same_body,
                                       std::size_t num_threads, InstructionSet at_most)
    : _facets(facet_points, facets, facets_in_block), _vertices(vertices.begin(), vertices.end()),
      _hash(vertices.size()), _searches(num_threads, Search(_facets, vertices.size(), at_most)),
      _workers(num_threads), _order(facets.size()), _is_same_body(is_same_body) {
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
    if (!extent_of_some(vertex_points, _vertices).meets(all.grown(reach)))
        return _candidates;
    const Extent near = keep_within(all.grown(reach), vertex_points, _vertices, _active);
    if (_active.empty())
        return _candidates;
    for (std::size_t k = 0; k < _facets.num_classes(); ++k) {
        _hash.fill(_active, near, voxel_per_block * _facets.mean_size()[k] + reach,
                   [&](Index v) -> const Position & { return vertex_points[at(v)]; });
        const auto blocks = _facets.blocks(k);
        _workers.hand_out(blocks.size(), [&](std::size_t worker, std::size_t b) {
            look_into(blocks[b], near, facet_points, reach, _searches[worker]);
        });
    }
    for (Search &search : _searches) {
        _candidates.insert(_candidates.end(), search.found.begin(), search.found.end());
        search.found.clear();
    }
    _order.sort(
        _candidates, [](const Pair &pair) { return pair[1]; },
        [](const Pair &pair) { return pair[0]; });
    return _candidates;
}

void VerticesNearFacets::look_into(const Blocks::Block &block, const Extent &near,
                                   std::span<const Position> facet_points, double reach,
                                   Search &search) const {
    const Extent box = _facets.extent(block, facet_points).grown(reach);
    if (!box.meets(near))
        return;
    const auto places = search.look_up(_hash, box, [](std::uint32_t) { return true; });
    if (places.empty())
        return;
    if (_is_same_body)
        search.mark(_facets, block);
    search.test(
        _facets, block, facet_points, reach, _hash.table(), places,
        [&](std::uint32_t k) {
            return _is_same_body ? search.with_corner(_facets, block, _hash.entries()[k].id) : 0;
        },
        [&](std::uint32_t k, Index facet) {
            search.found.push_back({_hash.entries()[k].id, facet});
        });
}

std::span<const VertexNearFacet> VerticesNearFacets::find(std::span<const Position> vertex_points,
                                                          std::span<const Position> facet_points,
                                                          double distance) {
    _found.clear();
    for (const auto &[vertex, facet] : find_candidates(vertex_points, facet_points, distance)) {
        VertexNearFacet pair{vertex, facet, {}, 0.0};
        if (is_near(vertex_points, facet_points, _facets.elements()[at(facet)], distance, pair))
            _found.push_back(pair);
    }
    return _found;
}

std::vector<double> VerticesNearFacets::voxel_sizes() const {
    std::vector<double> sizes;
    for (const double size : _facets.mean_size())
        sizes.push_back(voxel_per_block * size);
    std::sort(sizes.begin(), sizes.end());
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
