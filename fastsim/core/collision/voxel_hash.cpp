#include "collision/voxel_hash.hpp"

namespace fastsim {

namespace {

// Two to four buckets for each point: most voxels that are looked up are empty, and say so at
// once.
std::size_t num_buckets(std::size_t size) {
    std::size_t buckets = 64;
    while (buckets < 2 * size)
        buckets *= 2;
    return buckets;
}

} // namespace

VoxelHash::VoxelHash(std::size_t most)
    : _end(num_buckets(most) + 1), _bucket(most), _entries(most) {}

std::span<const std::uint32_t> VoxelHash::near(const Extent &box,
                                               std::span<std::uint32_t> room) const {
    // Written everywhere, kept where the point is in the box: no branch to be guessed.
    std::size_t count = 0;
    Voxel low, high;
    if (reach(box, low, high)) {
        if (is_wide(low, high)) {
            for (std::size_t k = 0; k < _size; ++k) {
                room[count] = static_cast<std::uint32_t>(k);
                count += box.contains(_entries[k].at) ? 1 : 0;
            }
        } else {
            const std::size_t across = static_cast<std::size_t>(high[0] - low[0]) + 1;
            const std::size_t buckets = static_cast<std::size_t>(_mask) + 1;
            Voxel v = low;
            for (v[2] = low[2]; v[2] <= high[2]; ++v[2])
                for (v[1] = low[1]; v[1] <= high[1]; ++v[1]) {
                    const std::size_t b = bucket_of(v), end = b + across;
                    const std::uint32_t row = row_of(v);
                    const auto look = [&](std::size_t first, std::size_t last) {
                        for (std::size_t k = first; k < last; ++k) {
                            room[count] = static_cast<std::uint32_t>(k);
                            count += _entries[k].row == row && box.contains(_entries[k].at) ? 1 : 0;
                        }
                    };
                    look(_end[b], _end[std::min(end, buckets)]);
                    if (end > buckets)
                        look(0, _end[end - buckets]);
                }
        }
    }
    return room.first(count);
}

void VoxelHash::open(std::size_t size, const Extent &extent, double voxel_size) {
    _size = size;
    _extent = extent;
    // A voxel too small for its inverse: one voxel then holds a whole axis, or all are the last.
    _per_length = std::min(1.0 / voxel_size, std::numeric_limits<double>::max());
    const std::size_t buckets = num_buckets(size);
    _mask = static_cast<std::uint32_t>(buckets - 1);
    std::fill_n(_end.begin(), buckets + 1, 0u);
}

void VoxelHash::sum_counts() {
    // From counts to where each bucket begins; filling then moves that to where it ends.
    const std::size_t buckets = static_cast<std::size_t>(_mask) + 1;
    std::uint32_t sum = 0;
    for (std::size_t b = 1; b <= buckets; ++b) {
        const std::uint32_t count = _end[b];
        _end[b] = sum;
        sum += count;
    }
}

} // namespace fastsim
