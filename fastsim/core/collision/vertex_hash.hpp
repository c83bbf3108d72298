#pragma once
// Vertices hashed into voxels (Teschner et al. 2003, "Optimized spatial hashing for collision
// detection of deformable objects"), kept from step to step: a vertex is touched only when its
// voxel changes, nothing is cleared, nothing is allocated after construction.

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace fastsim {

using Position = std::array<double, 3>;

struct Extent {
    Position low, high;

    [[nodiscard]] bool contains(const Position &p) const {
        for (std::size_t i = 0; i < 3; ++i)
            if (!(p[i] >= low[i] && p[i] <= high[i]))
                return false;
        return true;
    }
};

class VertexHash {
  public:
    using Index = std::int32_t;
    using Voxel = std::array<std::int32_t, 3>;

    // Pre-condition: voxel_size > 0. Vertices are numbered 0 to num_vertices - 1 here.
    VertexHash(std::size_t num_vertices, double voxel_size);

    // Takes the vertices to where they are now. Returns how many changed their voxel.
    // Pre-condition: finite, and below 2^30 voxels from the origin.
    std::size_t update(std::span<const Position> positions, std::span<const Index> vertices);

    [[nodiscard]] double voxel_size() const { return _voxel_size; }
    [[nodiscard]] Voxel voxel_of(const Position &p) const {
        // floor and the division are monotone, so a vertex within an extent lies in its voxels.
        return {static_cast<std::int32_t>(std::floor(p[0] / _voxel_size)),
                static_cast<std::int32_t>(std::floor(p[1] / _voxel_size)),
                static_cast<std::int32_t>(std::floor(p[2] / _voxel_size))};
    }

    // Calls visit(vertex) for each vertex in the voxels that an extent touches: all vertices in
    // it, and others near by; none twice.
    template <typename Visit> void near(const Extent &extent, Visit &&visit) const {
        const Voxel low = voxel_of(extent.low), high = voxel_of(extent.high);
        Voxel v;
        for (v[2] = low[2]; v[2] <= high[2]; ++v[2])
            for (v[1] = low[1]; v[1] <= high[1]; ++v[1])
                for (v[0] = low[0]; v[0] <= high[0]; ++v[0])
                    for (Index i = _head[bucket(v)]; i >= 0; i = _next[at(i)])
                        if (_voxel[at(i)] == v)
                            visit(i);
    }

    // The number of voxels an extent touches, saturating.
    [[nodiscard]] double count_voxels(const Extent &extent) const {
        const Voxel low = voxel_of(extent.low), high = voxel_of(extent.high);
        double n = 1.0;
        for (std::size_t i = 0; i < 3; ++i)
            n *= static_cast<double>(high[i]) - static_cast<double>(low[i]) + 1.0;
        return n;
    }

  private:
    static std::size_t at(Index i) { return static_cast<std::size_t>(i); }
    [[nodiscard]] std::size_t bucket(const Voxel &v) const {
        // The primes of Teschner et al., mixed once more: neighbours must not share low bits.
        const std::uint32_t h = (static_cast<std::uint32_t>(v[0]) * 73856093u) ^
                                (static_cast<std::uint32_t>(v[1]) * 19349663u) ^
                                (static_cast<std::uint32_t>(v[2]) * 83492791u);
        return (h ^ (h >> 15)) & _mask;
    }
    void unlink(Index i);
    void link(Index i);

    double _voxel_size;
    std::size_t _mask;
    std::vector<Index> _head;        // first vertex of each bucket, or -1
    std::vector<Index> _next, _prev; // lists within a bucket
    std::vector<Voxel> _voxel;       // of each vertex
    bool _is_filled = false;
};

} // namespace fastsim
