#include "mechanics/smoothing_patches.hpp"

#include <algorithm>

namespace fastsim {

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// Numbers pairs (first, second): those of one first in a chain of their own.
class PairNumbers {
  public:
    explicit PairNumbers(std::size_t num_firsts) : _newest(num_firsts, -1) {}

    Index number(Index first, Index second) {
        for (Index k = _newest[at(first)]; k >= 0; k = _older[at(k)])
            if (_second[at(k)] == second)
                return k;
        const auto made = static_cast<Index>(_second.size());
        _second.push_back(second);
        _older.push_back(_newest[at(first)]);
        _newest[at(first)] = made;
        return made;
    }

  private:
    std::vector<Index> _newest, _older, _second;
};

} // namespace

Groups rows_naming(std::span<const Index> table, std::size_t width, std::size_t num_groups) {
    Groups groups{std::vector<std::size_t>(num_groups + 1, 0), std::vector<Index>(table.size())};
    for (const Index group : table)
        ++groups.start[at(group) + 1];
    for (std::size_t k = 0; k < num_groups; ++k)
        groups.start[k + 1] += groups.start[k];
    std::vector<std::size_t> fill(groups.start.begin(), groups.start.end() - 1);
    for (std::size_t i = 0; i < table.size(); ++i)
        groups.members[fill[at(table[i])]++] = static_cast<Index>(i / width);
    return groups;
}

SmoothingPatches make_smoothing_patches(const ElasticCells &body, std::size_t num_points) {
    SmoothingPatches patches;
    patches.cell_edges.resize(6 * body.size());
    patches.cell_nodes.resize(4 * body.size());
    PairNumbers nodes(num_points), edges(4 * body.size()); // a node patch is one of one material
    for (std::size_t c = 0; c < body.size(); ++c) {
        const double volume = body.rest.volumes[c];
        const Index material = body.material_of[c];
        Index *const own = &patches.cell_nodes[4 * c];
        for (std::size_t a = 0; a < 4; ++a) {
            const Index point = body.cells[4 * c + a];
            own[a] = nodes.number(point, material);
            if (at(own[a]) == patches.num_nodes()) {
                patches.node_volume.push_back(0.0);
                patches.node_material.push_back(material);
                patches.node_point.push_back(point);
            }
            patches.node_volume[at(own[a])] += volume / 4.0;
        }
        for (std::size_t k = 0; k < 6; ++k) {
            const auto [low, high] = std::minmax(own[edge_corners[k][0]], own[edge_corners[k][1]]);
            const Index edge = edges.number(low, high);
            patches.cell_edges[6 * c + k] = edge;
            if (at(edge) == patches.num_edges()) {
                patches.edge_volume.push_back(0.0);
                patches.edge_material.push_back(material);
                patches.edge_ends.push_back({low, high});
            }
            patches.edge_volume[at(edge)] += volume / 6.0;
        }
    }
    return patches;
}

} // namespace fastsim
