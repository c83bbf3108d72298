#pragma once
// Better triangles on a surface, within a distance of it: splits, collapses, flips and moves
// (after Botsch, Kobbelt 2004, "A remeshing approach to multiresolution modeling"), each refused
// where the new facets leave the distance or turn.

#include "lattice/size_grid.hpp"
#include "surface/editable_surface.hpp"

#include <functional>

namespace fastsim {

struct RemeshSettings {
    const SizeGrid &sizes; // wanted edge lengths, [m]
    double distance;       // from the given surface at most, [m]
    int passes;
};

struct RemeshedSurface {
    std::vector<Point> points;
    std::vector<EditableSurface::Facet> facets;
    std::size_t splits = 0, collapses = 0, flips = 0, moves = 0;
};

// `tell` is called now and then with the part that is done, 0 to 1.
// Pre-condition: closed, manifold, oriented, finite; at least one facet.
RemeshedSurface remesh_surface(std::span<const Point> points,
                               std::span<const EditableSurface::Facet> facets,
                               const RemeshSettings &settings,
                               const std::function<void(double)> &tell);

} // namespace fastsim
