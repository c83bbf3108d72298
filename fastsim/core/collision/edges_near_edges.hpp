#pragma once
// Which edges come within a distance of which others: of another body, or of the same one.

#include "collision/block_search.hpp"
#include "collision/pair_order.hpp"
#include "threads/workers.hpp"

namespace fastsim {

struct EdgeNearEdge {
    std::int32_t first, second;       // edges of the first and of the second body
    std::array<double, 2> parameters; // of their nearest points, 0 to 1 along each
    double distance_squared;
};

// Edges of the first body are hashed by their middles; what half an edge may add is added to the
// boxes that are looked up.
class EdgesNearEdges {
  public:
    using Index = std::int32_t;
    using Edge = std::array<Index, 2>;
    using Pair = std::array<Index, 2>; // first, second

    // Sizes are taken from the points as they are now. `is_same_body`: both lists are the same,
    // a pair is given once, its first edge having the lower number, and edges with a common
    // point do not count.
    EdgesNearEdges(std::span<const Position> first_points, std::span<const Edge> first,
                   std::span<const Position> second_points, std::span<const Edge> second,
                   bool is_same_body, std::size_t num_threads, InstructionSet at_most);

    // Candidates: pairs whose closed boxes meet, one grown by `reach_of`. By second edge, then by
    // first; valid until the next call. Throws std::invalid_argument when a point is not finite.
    // Pre-condition: distance >= 0, finite.
    std::span<const Pair> find_candidates(std::span<const Position> first_points,
                                          std::span<const Position> second_points, double distance);

    // Of the candidates, those no further apart than the distance.
    std::span<const EdgeNearEdge> find(std::span<const Position> first_points,
                                       std::span<const Position> second_points, double distance);

  private:
    using Blocks = ElementBlocks<2>;
    using Search = BlockSearch<2, Pair>;
    struct SizeClass {
        double size = 0.0;         // mean of its edges, at the time of construction
        std::vector<Index> active; // its edges that are near the other body
        Extent middles{};          // box of their middles
        Position half{};           // largest half of a box, along each axis
    };
    void take_active(std::span<const Position> first_points, const Extent &near);
    void hash(const SizeClass &one, std::span<const Position> first_points, double voxel_size);
    void look_into(const Blocks::Block &block, const SizeClass &one,
                   std::span<const Position> second_points, double reach, Search &search) const;

    std::vector<Edge> _given;         // the first edges, as given
    std::vector<Edge> _first;         // the same in compact order
    std::vector<Index> _first_number; // of each of them
    Blocks _second;
    std::vector<std::uint8_t> _class; // of the first body's edges
    std::vector<SizeClass> _classes;
    VoxelHash _hash;
    std::vector<Extent> _hashed;   // boxes of the hashed edges, in the order of the hash
    std::vector<Search> _searches; // one for each thread
    Workers _workers;
    std::vector<Pair> _candidates;
    PairOrder<Pair> _order;
    std::vector<EdgeNearEdge> _found;
    bool _is_same_body;
};

// The narrow phase of one pair; true when it is within the distance.
bool is_near(std::span<const Position> first_points, const std::array<std::int32_t, 2> &first,
             std::span<const Position> second_points, const std::array<std::int32_t, 2> &second,
             double distance, EdgeNearEdge &pair);

// The oracle: every edge against every edge; with the candidates, or the pairs within the
// distance alone.
std::vector<EdgeNearEdge> find_edges_near_edges_brute_force(
    std::span<const Position> first_points, std::span<const std::array<std::int32_t, 2>> first,
    std::span<const Position> second_points, std::span<const std::array<std::int32_t, 2>> second,
    double distance, bool is_same_body, bool only_candidates);

} // namespace fastsim
