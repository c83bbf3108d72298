#pragma once
// Candidate points inside the body: steps 2 to 4 of the paper's section II. A lattice over the
// bounding box, disarranged a little, of which the points well inside are kept.

#include "lattice/size_grid.hpp"

#include <span>
#include <vector>

namespace fastsim {

enum class Lattice {
    cubic,        // the paper's small cubes
    body_centred, // cubes and their centres: its Delaunay cells are all alike and far from flat
};

struct LatticeSettings {
    Lattice lattice;
    double edge_length; // wanted edge length of the cells
    double jitter;      // largest shift along each axis, in parts of the edge length
    double clearance;   // smallest distance from surface points, in parts of the edge length
    std::uint64_t seed;
    // Cells grow from the surface's edges to the wanted length as quickly as the lattice lets them.
    bool grows_inwards = false;
};

/// `sizes` may ask for less than the lattice's edge length here and there (body-centred only).
std::vector<Point> interior_points(std::span<const Point> surface_points,
                                   std::span<const Triple> facets, LatticeSettings settings,
                                   const SizeGrid &sizes);

} // namespace fastsim
