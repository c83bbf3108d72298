#pragma once
// The paper's section II, steps 1 to 5, in order.

#include "lattice/interior_points.hpp"
#include "recovery/boundary_recovery.hpp"
#include "slivers/sliver_removal.hpp"

#include <string>

namespace fastsim {

struct MeshSettings {
    LatticeSettings lattice;
    double sliver_target;  // smallest sine of a dihedral angle below which cells are improved
    int sliver_passes;     // 0 leaves the slivers
    double least_altitude; // cells below it are improved, too; 0 takes what the surface suggests
    SliverBudget sliver_budget;
    bool lengthens_step; // the cells that decide the time step are improved at the end
};

struct SurfaceMesh {
    std::vector<Point> points; // the surface's first, in their order
    std::vector<Cell> cells;
    RecoveryReport recovery;
    SliverReport slivers;
    // Points that had to stay on the surface's edges and facets; they follow the surface's own.
    std::size_t num_boundary_steiner = 0;
    std::array<Index, 2> equal_points{none, none}; // two of them, when there are any
    std::string stopped_in; // the stage in which the time was up; there are no cells then
};

/// Meshes the inside of a closed, outward surface. When `recovery` lists missing edges or facets,
/// or `equal_points` or `stopped_in` is set, there are no cells.
SurfaceMesh mesh_surface(std::span<const Point> points, std::span<const Triple> facets,
                         const MeshSettings &settings, const SizeGrid &sizes, Watch &watch);

} // namespace fastsim
