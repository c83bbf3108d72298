#pragma once
// A lattice of cubes and their centres that is finer where the surface is: cubes are halved near
// small edges, and neighbours differ by one halving at most, so that sizes change gradually.

#include "mesher/tet_complex.hpp"

#include <functional>
#include <span>
#include <unordered_set>
#include <vector>

namespace fastsim {

/// Cubes of one size over a box.
struct CubeGrid {
    Point low;
    double edge;
    std::array<Index, 3> count; // cubes along each axis
};

/// When cubes are halved.
struct Halving {
    double tolerance; // a cube may be larger than wanted by as much; sizes go by octaves
    double reach;     // around a wide place, in wanted edges
};

/// For cells that are nearly all alike: less would halve cubes all along a surface whose edges
/// only scatter.
constexpr Halving for_uniform{2.0, 1.5};
/// For cells that grow inwards: the first cubes are up to twice as large as the surface's edges,
/// and lie in as thin a layer as neighbours allow.
constexpr Halving for_growing{2.6, 0.5};

class GradedLattice {
  public:
    /// Halves cubes until they are about as large as wanted at each of some places; around the
    /// first `num_wide` of them within a reach, at the others only where they lie.
    GradedLattice(const CubeGrid &grid, std::span<const Point> places,
                  std::span<const double> wanted_edges, std::size_t num_wide, Halving halving);

    /// Calls with every corner of a cube, and with every centre where `has_centres`, and the edge
    /// of a cube there; in an order that depends on nothing else.
    void visit(bool has_centres, const std::function<void(const Point &, double)> &take) const;

  private:
    using Key = std::uint64_t;
    using Cube = std::array<Index, 3>;
    using Level = std::unordered_set<Key>;

    static Key pack(const Cube &cube);
    static Cube unpack(Key key);
    bool is_split(std::size_t level, const Cube &cube) const;
    Point corner(const Cube &cube, double edge, double shift) const;

    CubeGrid _grid;
    std::vector<Level> _split; // cubes that are halved, by level
};

} // namespace fastsim
