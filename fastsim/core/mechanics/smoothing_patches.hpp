#pragma once
// Where strain is averaged: the cells of one material around each edge and around each node.
//
//   V_e = sum of V_c / 6 over the cells at an edge,  V_n = sum of V_c / 4 over those at a node
//
// An edge or node where materials meet has a patch for each, so that nothing is averaged across.

#include "mechanics/tet4.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace fastsim {

/// Corners of the six edges of a cell.
inline constexpr std::array<std::array<std::size_t, 2>, 6> edge_corners{
    {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};

/// Members of numbered groups, group by group.
struct Groups {
    std::vector<std::size_t> start; // one more than there are groups
    std::vector<Index> members;

    std::size_t size() const { return start.size() - 1; }
    std::span<const Index> of(std::size_t group) const {
        return {members.data() + start[group], start[group + 1] - start[group]};
    }
};

/// Groups of the rows of a table (`width` entries each) that name them; in ascending order.
Groups rows_naming(std::span<const Index> table, std::size_t width, std::size_t num_groups);

struct SmoothingPatches {
    std::vector<Index> cell_edges;               // six for each cell, as in `edge_corners`
    std::vector<Index> cell_nodes;               // four for each cell
    std::vector<std::array<Index, 2>> edge_ends; // node patches
    std::vector<double> edge_volume, node_volume;
    std::vector<Index> edge_material, node_material;
    std::vector<Index> node_point;

    std::size_t num_edges() const { return edge_volume.size(); }
    std::size_t num_nodes() const { return node_volume.size(); }
};

/// Numbered by the cells that name them first.
SmoothingPatches make_smoothing_patches(const ElasticCells &body, std::size_t num_points);

} // namespace fastsim
