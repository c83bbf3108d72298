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
