#include "collision/vertex_hash.hpp"

namespace fastsim {

VertexHash::VertexHash(std::size_t num_vertices, double voxel_size)
    : _voxel_size(voxel_size), _next(num_vertices, -1), _prev(num_vertices, -1),
      _voxel(num_vertices) {
    // Four buckets for each vertex: most voxels that are looked up are empty, and say so at once.
    std::size_t buckets = 64;
    while (buckets < 4 * num_vertices)
        buckets *= 2;
    _mask = buckets - 1;
    _head.assign(buckets, -1);
}

std::size_t VertexHash::update(std::span<const Position> positions,
                               std::span<const Index> vertices) {
    std::size_t changed = 0;
    for (std::size_t k = 0; k < vertices.size(); ++k) {
        const Voxel now = voxel_of(positions[at(vertices[k])]);
        const auto i = static_cast<Index>(k);
        if (_is_filled) {
            if (now == _voxel[k])
                continue;
            unlink(i);
        }
        _voxel[k] = now;
        link(i);
        ++changed;
    }
    _is_filled = true;
    return changed;
}

void VertexHash::unlink(Index i) {
    const Index next = _next[at(i)], prev = _prev[at(i)];
    if (prev >= 0)
        _next[at(prev)] = next;
    else
        _head[bucket(_voxel[at(i)])] = next;
    if (next >= 0)
        _prev[at(next)] = prev;
}

void VertexHash::link(Index i) {
    Index &head = _head[bucket(_voxel[at(i)])];
    _next[at(i)] = head;
    _prev[at(i)] = -1;
    if (head >= 0)
        _prev[at(head)] = i;
    head = i;
}

} // namespace fastsim
