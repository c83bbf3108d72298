#pragma once
// How often any facets, closed or not, wind around a place: 1 inside, 0 outside, between the two
// near holes.

#include "surface/box_tree.hpp"

#include <vector>

namespace fastsim {

class WindingTree {
  public:
    // Keeps references. Pre-condition: at least one facet.
    WindingTree(std::span<const Point> points, std::span<const std::array<std::int32_t, 3>> facets,
                const BoxTree &tree);

    // Solid angle / 4 pi: exact for near facets, of a dipole for far ones (Barill, Dickson,
    // Schmidt, Levin, Jacobson 2018, "Fast winding numbers for soups and clouds").
    [[nodiscard]] double at(const Point &place) const;

  private:
    struct Dipole {
        Point centre{}, area{}; // [m], [m2]
        double weight = 0.0, radius = 0.0;
    };

    std::span<const Point> _points;
    std::span<const std::array<std::int32_t, 3>> _facets;
    const BoxTree &_tree;
    std::vector<Dipole> _dipoles; // of the tree's nodes
};

} // namespace fastsim
