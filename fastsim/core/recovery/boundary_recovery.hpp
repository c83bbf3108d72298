#pragma once
// "Check boundary points and topology preservation" (section II, step 5): every edge and facet
// of the given surface is brought into the tetrahedralisation, edges first.
//
//   1. needles in one plane by flips in that plane (plane_recovery.hpp);
//   2. the rest by flips; what is there is protected from later flips;
//   3. where flips are stuck, by points on the edge or facet, where cells cross it. Coordinates
//      are rounded, so such an edge or facet bends by roundings; what is inside is decided by
//      the bent triangles, exactly. The points are moved off the surface after carving
//      (steiner_removal.hpp; after George, Borouchaki and Saltel 2003, Si 2015).

#include "mesher/flips.hpp"
#include "mesher/watch.hpp"
#include "recovery/refined_surface.hpp"

#include <optional>
#include <span>
#include <vector>

namespace fastsim {

struct RecoveryReport {
    std::vector<std::array<Index, 2>> missing_edges;
    std::vector<Index> missing_facets; // indices of the given facets
    std::size_t recovered_edges = 0;   // by flips alone
    std::size_t recovered_facets = 0;  // by flips alone
    // Only where points were put on the surface: its parts, and those points in order of
    // insertion.
    std::optional<RefinedSurface> refined;
    std::vector<Index> steiner_points;
};

/// Brings the facets into the complex; `protection` comes out holding what is there. Points from
/// `first_inner` on are not the surface's.
RecoveryReport recover_boundary(TetComplex &complex, std::span<const Triple> facets,
                                Index first_inner, Protection &protection, Watch &watch);

} // namespace fastsim
