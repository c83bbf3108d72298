#include "mesher/mesh_surface.hpp"

#include "delaunay/triangulation.hpp"
#include "mesher/carve.hpp"
#include "recovery/steiner_removal.hpp"
#include "slivers/flat_cells.hpp"
#include "slivers/time_step.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

namespace fastsim {

namespace {

constexpr Index cube_corners = 8;
// Of the Delaunay cells, where there are as many points inside.
constexpr std::size_t bytes_per_point = 1024;
// Far enough that the cube's corners hardly spoil the cells at the surface.
constexpr double cube_margin = 3.0;
// Angles of 27 degrees may be given up to for a longer time step: what is above is no sliver that
// more work is spent on. Where an altitude is asked for, 15 degrees.
constexpr double least_sine_for_step = 0.4536, least_sine_for_altitude = 0.2588;

/// Takes a block as large as the largest table of the mesher, and gives it back. From that glibc
/// learns to serve such tables from its heap, and to keep what is freed for the next one. Otherwise
/// each is a mapping of its own, whose pages come one by one: a twentieth of a small mesh's time.
void accustom_heap(std::size_t num_points) {
    void *volatile block = std::malloc(bytes_per_point * num_points);
    std::free(block);
}

/// Corners of a cube around all points, `margin` box sizes away.
std::array<Point, 8> cube_corners_around(std::span<const Point> points, double margin) {
    Point low = points.front(), high = points.front();
    double size = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
        for (const Point &p : points) {
            low[i] = std::min(low[i], p[i]);
            high[i] = std::max(high[i], p[i]);
        }
        size = std::max(size, high[i] - low[i]);
    }
    const double reach = (0.5 + margin) * size;
    std::array<Point, 8> corners;
    for (std::size_t corner = 0; corner < 8; ++corner)
        for (std::size_t i = 0; i < 3; ++i) {
            const double centre = 0.5 * (low[i] + high[i]);
            corners[corner][i] = (corner >> i) & 1 ? centre + reach : centre - reach;
        }
    return corners;
}

/// Numbers points `chosen` from `first` on, in their order; the rest keep theirs among themselves.
void bring_forward(TetComplex &complex, std::span<const Index> chosen, Index first) {
    const auto count = static_cast<Index>(complex.points.size());
    std::vector<Index> number(complex.points.size(), none);
    Index next = first;
    for (const Index v : chosen)
        number[TetComplex::at(v)] = next++;
    for (Index v = 0; v < count; ++v)
        if (number[TetComplex::at(v)] == none)
            number[TetComplex::at(v)] = v < first ? v : next++;
    std::vector<Point> points(complex.points.size());
    for (std::size_t v = 0; v < points.size(); ++v)
        points[TetComplex::at(number[v])] = complex.points[v];
    // Slots close up.
    std::vector<Index> slot_number(complex.num_slots(), none);
    Index num_cells = 0;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot)
        if (complex.is_alive(static_cast<Index>(slot)))
            slot_number[slot] = num_cells++;
    std::vector<Cell> cells, neighbours;
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
        const auto c = static_cast<Index>(slot);
        if (!complex.is_alive(c))
            continue;
        Cell cell = complex.cell(c), beyond{none, none, none, none};
        for (std::size_t k = 0; k < 4; ++k) {
            cell[k] = number[TetComplex::at(cell[k])];
            const Index n = complex.neighbour(c, static_cast<int>(k));
            if (n != none)
                beyond[k] = slot_number[TetComplex::at(n)];
        }
        cells.push_back(cell);
        neighbours.push_back(beyond);
    }
    complex = TetComplex();
    complex.add_points(points);
    complex.set_cells(std::move(cells), std::move(neighbours));
}

/// Points on the boundary keep their order, without the cube; inner points that no cell uses are
/// dropped.
void collect(const TetComplex &inside, Index num_fixed, SurfaceMesh &result) {
    std::vector<Index> number(inside.points.size(), none);
    result.points.reserve(inside.points.size());
    result.cells.reserve(inside.num_slots());
    for (Index v = cube_corners; v < num_fixed; ++v) {
        number[TetComplex::at(v)] = v - cube_corners;
        result.points.push_back(inside.points[TetComplex::at(v)]);
    }
    for (std::size_t slot = 0; slot < inside.num_slots(); ++slot) {
        const auto c = static_cast<Index>(slot);
        if (!inside.is_alive(c))
            continue;
        Cell cell = inside.cell(c);
        for (Index &v : cell) {
            Index &n = number[TetComplex::at(v)];
            if (n == none) {
                n = static_cast<Index>(result.points.size());
                result.points.push_back(inside.points[TetComplex::at(v)]);
            }
            v = n;
        }
        result.cells.push_back(cell);
    }
}

SurfaceMesh fill_surface(std::span<const Point> points, std::span<const Triple> facets,
                         const MeshSettings &settings, const SizeGrid &sizes, Watch &watch) {
    SurfaceMesh result;
    const auto num_surface = static_cast<Index>(points.size());

    accustom_heap(points.size());
    // 1. The circum-cube. The paper cuts it into five cells and inserts into them; here its
    // corners are points like the others, which gives the same cells.
    TetComplex complex;
    complex.add_points(cube_corners_around(points, cube_margin));
    complex.add_points(points);

    // 2 to 4. Lattice, disarranged, those well inside.
    watch.begin("placing points", 0);
    complex.add_points(interior_points(points, facets, settings.lattice, sizes));

    // 5. Insert by Delaunay's criterion, the cube's corners among the points.
    watch.begin("inserting points", complex.points.size() - TetComplex::at(cube_corners));
    DelaunayCells delaunay = Triangulation(complex.points).build(watch, true);
    if (!delaunay.duplicates.empty()) {
        const Index late = delaunay.duplicates.front();
        for (Index v = 0; v < static_cast<Index>(complex.points.size()); ++v)
            if (v != late &&
                complex.points[TetComplex::at(v)] == complex.points[TetComplex::at(late)])
                result.equal_points = {std::min(v, late) - cube_corners,
                                       std::max(v, late) - cube_corners};
        return result;
    }
    complex.set_cells(std::move(delaunay.cells), std::move(delaunay.neighbours));

    // Boundary points and topology.
    std::vector<Triple> shifted(facets.begin(), facets.end());
    for (Triple &f : shifted)
        for (Index &v : f)
            v += cube_corners;
    Protection protection;
    RecoveryReport &recovery = result.recovery;
    recovery = recover_boundary(complex, shifted, cube_corners + num_surface, protection, watch);
    if (!recovery.missing_edges.empty() || !recovery.missing_facets.empty()) {
        for (auto &e : recovery.missing_edges)
            for (Index &v : e)
                v -= cube_corners;
        return result;
    }

    const std::vector<Triple> walls = recovery.refined ? recovery.refined->triangles() : shifted;
    // On the inside alone from here: the boundary has no neighbours, so no flip touches it.
    TetComplex inside = carve(complex, walls);
    if (inside.num_slots() == 0) {
        for (std::size_t f = 0; f < facets.size(); ++f)
            recovery.missing_facets.push_back(static_cast<Index>(f));
        return result;
    }

    std::vector<Index> stuck;
    if (recovery.refined) {
        watch.begin("moving points off the surface", recovery.steiner_points.size());
        stuck = remove_steiner_points(inside, *recovery.refined, shifted, recovery.steiner_points,
                                      watch);
    }
    double altitude = 0.0;
    CellRatings ratings;
    const auto rate = [&] {
        altitude =
            settings.least_altitude > 0.0 ? settings.least_altitude : find_wanted_altitude(inside);
        ratings = rate_all_cells(inside, altitude);
    };
    rate();
    const bool has_flat = has_flat_cell(inside, ratings.sines);
    // The boundary has no neighbours: nothing has to be protected.
    if (has_flat)
        remove_flat_cells(inside, {}, true);
    if (!stuck.empty())
        bring_forward(inside, stuck, cube_corners + num_surface);
    if (has_flat || !stuck.empty())
        rate();
    result.num_boundary_steiner = stuck.size();
    const Index num_fixed = cube_corners + num_surface + static_cast<Index>(stuck.size());
    watch.begin("improving cells", inside.num_slots());
    if (settings.sliver_passes > 0) {
        inside.wanted_altitude = altitude;
        result.slivers = remove_slivers(inside, num_fixed, ratings, settings.sliver_target,
                                        settings.sliver_passes, settings.sliver_budget, watch);
        inside.wanted_altitude = 0.0; // from now on angles alone count
        if (settings.lengthens_step)
            lengthen_time_step(inside, num_fixed, ratings,
                               settings.least_altitude > 0.0 ? least_sine_for_altitude
                                                             : least_sine_for_step,
                               watch);
        result.slivers.left = count_slivers(inside, ratings.sines);
    }
    collect(inside, num_fixed, result);
    return result;
}

} // namespace

SurfaceMesh mesh_surface(std::span<const Point> points, std::span<const Triple> facets,
                         const MeshSettings &settings, const SizeGrid &sizes, Watch &watch) {
    try {
        return fill_surface(points, facets, settings, sizes, watch);
    } catch (const TimeUp &up) {
        SurfaceMesh none_made;
        none_made.stopped_in = up.stage;
        return none_made;
    }
}

} // namespace fastsim
