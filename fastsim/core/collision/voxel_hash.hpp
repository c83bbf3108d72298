#pragma once
// Points hashed into voxels (after Teschner et al. 2003, "Optimized spatial hashing for collision
// detection of deformable objects"): rows of voxels along x start at a hashed bucket and run on
// from there, so that the neighbours of a row lie side by side in memory. The table is as large
// as what it holds, is filled anew by counting, and nothing is allocated after construction.

#include "collision/block_boxes.hpp"

#include <cstddef>
#include <vector>

namespace fastsim {

class VoxelHash {
  public:
    using Index = std::int32_t;

    struct Entry {
        Position at;
        Index id;
        std::uint32_t row; // low bits of the voxel's y and z: tells rows of one bucket apart
    };

    // Room for that many points.
    explicit VoxelHash(std::size_t most);

    // Hashes points by their ids, place(id) being a Position within the extent.
    // Pre-condition: at most as many as there is room for; finite; voxel_size > 0.
    template <typename Place>
    void fill(std::span<const Index> ids, const Extent &extent, double voxel_size, Place &&place) {
        open(ids.size(), extent, voxel_size);
        for (std::size_t k = 0; k < ids.size(); ++k) {
            const Voxel v = voxel_of(place(ids[k]));
            _bucket[k] = bucket_of(v);
            ++_end[_bucket[k] + 1];
        }
        sum_counts();
        for (std::size_t k = 0; k < ids.size(); ++k) {
            const Position p = place(ids[k]);
            _entries[_end[_bucket[k] + 1]++] = {p, ids[k], row_of(voxel_of(p))};
        }
    }

    // All points, those of a bucket together; within a bucket in the order given.
    [[nodiscard]] std::span<const Entry> entries() const { return {_entries.data(), _size}; }

    [[nodiscard]] PointTable table() const {
        static_assert(sizeof(Entry) % sizeof(double) == 0);
        const double *first = _entries.empty() ? nullptr : _entries.front().at.data();
        return {first, sizeof(Entry) / sizeof(double)};
    }

    // Places in entries() of the points in the closed box, each once, at the front of `room`, which
    // is longer than all there are.
    std::span<const std::uint32_t> near(const Extent &box, std::span<std::uint32_t> room) const;

  private:
    using Voxel = std::array<std::int32_t, 3>;

    // Voxels are counted from the low corner of the extent, and the last one has no end: all of
    // this is monotone, so a point within a box lies in the box's voxels, however far away.
    [[nodiscard]] std::int32_t step_of(double x, std::size_t i) const {
        return static_cast<std::int32_t>(std::min((x - _extent.low[i]) * _per_length, _most));
    }
    [[nodiscard]] Voxel voxel_of(const Position &p) const {
        return {step_of(p[0], 0), step_of(p[1], 1), step_of(p[2], 2)};
    }
    [[nodiscard]] static std::uint32_t row_of(const Voxel &v) {
        return (static_cast<std::uint32_t>(v[1]) & 0xffffu) | static_cast<std::uint32_t>(v[2])
                                                                  << 16;
    }
    [[nodiscard]] std::uint32_t bucket_of(const Voxel &v) const {
        // The primes of Teschner et al. for y and z, mixed once more; x runs on.
        const std::uint32_t h = (static_cast<std::uint32_t>(v[1]) * 19349663u) ^
                                (static_cast<std::uint32_t>(v[2]) * 83492791u);
        return ((h ^ (h >> 15)) + static_cast<std::uint32_t>(v[0])) & _mask;
    }
    [[nodiscard]] bool reach(const Extent &box, Voxel &low, Voxel &high) const {
        if (_size == 0 || !box.meets(_extent))
            return false;
        const Extent both = box.common_with(_extent);
        low = voxel_of(both.low);
        high = voxel_of(both.high);
        return true;
    }
    // More rows than points, or rows that the table cannot tell apart.
    [[nodiscard]] bool is_wide(const Voxel &low, const Voxel &high) const {
        const auto across = [&](std::size_t i) {
            return static_cast<std::size_t>(high[i] - low[i]) + 1;
        };
        return across(0) > _mask || across(1) > 0xffffu || across(2) > 0xffffu ||
               across(1) * across(2) > _size;
    }
    void open(std::size_t size, const Extent &extent, double voxel_size);
    void sum_counts();

    static constexpr double _most = 1073741823.0; // 2^30 - 1
    Extent _extent{};
    double _per_length = 1.0;
    std::size_t _size = 0;
    std::uint32_t _mask = 0;
    std::vector<std::uint32_t> _end; // of bucket b: at b + 1
    std::vector<std::uint32_t> _bucket;
    std::vector<Entry> _entries;
};

} // namespace fastsim
