#pragma once
// Which vertices come within a distance of which triangles: of another body, or of the same one.

#include "collision/block_search.hpp"
#include "collision/pair_order.hpp"
#include "threads/workers.hpp"

namespace fastsim {

struct VertexNearFacet {
    std::int32_t vertex, facet;
    std::array<double, 3> weights; // of the nearest point of the facet
    double distance_squared;
};

class VerticesNearFacets {
  public:
    using Index = std::int32_t;
    using Facet = std::array<Index, 3>;
    using Pair = std::array<Index, 2>; // vertex, facet

    // Sizes are taken from the points as they are now. `is_same_body`: vertices number the facets'
    // own points, and a facet's corners do not count.
    VerticesNearFacets(std::span<const Position> facet_points, std::span<const Facet> facets,
                       std::span<const Index> vertices, bool is_same_body, std::size_t num_threads,
                       InstructionSet at_most);

    // Candidates: pairs with the vertex in the facet's closed box, grown by `reach_of`. By facet,
    // then by vertex; valid until the next call. Throws std::invalid_argument when a point
    // is not finite. Pre-condition: distance >= 0, finite.
    std::span<const Pair> find_candidates(std::span<const Position> vertex_points,
                                          std::span<const Position> facet_points, double distance);

    // Of the candidates, those with the facet no further than the distance from the vertex.
    std::span<const VertexNearFacet> find(std::span<const Position> vertex_points,
                                          std::span<const Position> facet_points, double distance);

    // Of each class of facets, ascending, when the distance is 0.
    [[nodiscard]] std::vector<double> voxel_sizes() const;

  private:
    using Blocks = ElementBlocks<3>;
    using Search = BlockSearch<3, Pair>;
    void look_into(const Blocks::Block &block, const Extent &near,
                   std::span<const Position> facet_points, double reach, Search &search) const;

    Blocks _facets;
    std::vector<Index> _vertices, _active;
    VoxelHash _hash;
    std::vector<Search> _searches; // one for each thread
    Workers _workers;
    std::vector<Pair> _candidates;
    PairOrder<Pair> _order;
    std::vector<VertexNearFacet> _found;
    bool _is_same_body;
};

// The narrow phase of one pair; true when it is within the distance.
bool is_near(std::span<const Position> vertex_points, std::span<const Position> facet_points,
             const std::array<std::int32_t, 3> &facet, double distance, VertexNearFacet &pair);

// The oracle: every vertex against every facet; with the candidates, or the pairs within the
// distance alone.
std::vector<VertexNearFacet> find_vertices_near_facets_brute_force(
    std::span<const Position> vertex_points, std::span<const std::int32_t> vertices,
    std::span<const Position> facet_points, std::span<const std::array<std::int32_t, 3>> facets,
    double distance, bool is_same_body, bool only_candidates);

} // namespace fastsim
