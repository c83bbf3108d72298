#include "collision/vertices_in_cells.hpp"

#include "predicates/vector_algebra.hpp"

#include <bit>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Cell = std::array<Index, 4>;

// Tried on bodies of 50 000 to 1.6 million cells, from 16 to 64, and from 0.25 to 1 block.
constexpr std::size_t cells_in_block = 64;
constexpr double voxel_per_block = 0.5;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool is_corner(Index vertex, const Cell &cell) {
    return vertex == cell[0] || vertex == cell[1] || vertex == cell[2] || vertex == cell[3];
}

} // namespace

bool is_in_cell(const Position &p, std::span<const Position> points, const Cell &cell,
                std::array<double, 4> &weights) {
    const Position &origin = points[at(cell[0])];
    const Position a = minus(points[at(cell[1])], origin), b = minus(points[at(cell[2])], origin),
                   c = minus(points[at(cell[3])], origin), q = minus(p, origin);
    const Position normal = cross(b, c);
    const double volume = dot(a, normal);
    if (!(volume > 0.0 && volume <= std::numeric_limits<double>::max()))
        return false;
    weights[1] = dot(normal, q);
    if (!(weights[1] >= 0.0))
        return false;
    weights[2] = dot(cross(c, a), q);
    if (!(weights[2] >= 0.0))
        return false;
    weights[3] = dot(cross(a, b), q);
    if (!(weights[3] >= 0.0))
        return false;
    for (std::size_t k = 1; k < 4; ++k)
        weights[k] /= volume;
    weights[0] = 1.0 - weights[1] - weights[2] - weights[3];
    return weights[0] >= 0.0;
}

VerticesInCells::VerticesInCells(std::span<const Position> cell_points, std::span<const Cell> cells,
                                 std::span<const Index> vertices, bool is_same_body,
                                 std::size_t num_threads, InstructionSet at_most)
    : _cells(cell_points, cells, cells_in_block), _vertices(vertices.begin(), vertices.end()),
      _hash(vertices.size()), _searches(num_threads, Search(_cells, vertices.size(), at_most)),
      _workers(num_threads),
      _end(vertices.empty() ? 1 : at(*std::max_element(vertices.begin(), vertices.end())) + 2),
      _is_same_body(is_same_body) {
    _active.reserve(vertices.size());
    _found.reserve(vertices.size() + 64); // grows, once, where more are found
}

std::span<const VertexInCell> VerticesInCells::find(std::span<const Position> vertex_points,
                                                    std::span<const Position> cell_points) {
    _found.clear();
    _work = {};
    // Only vertices in the box of all cells count, and only cells that meet the box of those.
    const Extent body = extent_of_all(cell_points);
    if (!extent_of_some(vertex_points, _vertices).meets(body))
        return _found;
    const Extent near = keep_within(body, vertex_points, _vertices, _active);
    if (_active.empty())
        return _found;
    for (std::size_t k = 0; k < _cells.num_classes(); ++k) {
        _hash.fill(_active, near, voxel_per_block * _cells.mean_size()[k],
                   [&](Index v) -> const Position & { return vertex_points[at(v)]; });
        _work.hashed += _active.size();
        const auto blocks = _cells.blocks(k);
        _workers.hand_out(blocks.size(), [&](std::size_t worker, std::size_t b) {
            look_into(blocks[b], near, cell_points, _searches[worker]);
        });
    }
    for (Search &search : _searches) {
        _found.insert(_found.end(), search.found.begin(), search.found.end());
        _work.cells_near += std::exchange(search.cells_near, 0);
        _work.pairs_tested += std::exchange(search.pairs_tested, 0);
        search.found.clear();
    }
    sort_found();
    return _found;
}

// By vertex, then by cell, without taking memory: by counting where there are many.
void VerticesInCells::sort_found() {
    const auto less = [](const VertexInCell &a, const VertexInCell &b) {
        return a.vertex != b.vertex ? a.vertex < b.vertex : a.cell < b.cell;
    };
    if (8 * _found.size() < _end.size()) {
        std::sort(_found.begin(), _found.end(), less);
        return;
    }
    std::fill(_end.begin(), _end.end(), 0u);
    for (const VertexInCell &pair : _found)
        ++_end[at(pair.vertex) + 1];
    for (std::size_t k = 1; k < _end.size(); ++k)
        _end[k] += _end[k - 1];
    // The entry of a vertex is where the next pair of it goes.
    _sorted.resize(_found.size());
    for (const VertexInCell &pair : _found)
        _sorted[_end[at(pair.vertex)]++] = pair;
    _found.swap(_sorted);
    for (auto first = _found.begin(), last = first; first != _found.end(); first = last) {
        while (last != _found.end() && last->vertex == first->vertex)
            ++last;
        if (last - first > 1)
            std::sort(first, last, less);
    }
}

void VerticesInCells::look_into(const CellBlocks::Block &block, const Extent &near,
                                std::span<const Position> cell_points, Search &search) const {
    const Extent box = _cells.extent(block, cell_points);
    if (!box.meets(near))
        return;
    const auto places = _hash.near(box, search.near);
    if (places.empty())
        return;
    search.cells_near += block.last - block.first;
    if (_is_same_body)
        _cells.mark(block, search.marks);
    _cells.fit(block, cell_points, search.boxes);
    search.boxes.find_holding(_hash.table(), places, search.bits.data());
    for (std::size_t j = 0; j < places.size(); ++j) {
        const auto &[p, v, row] = _hash.entries()[places[j]];
        std::uint64_t bits = search.bits[j];
        if (_is_same_body)
            bits &= ~_cells.with_corner(block, v, search.marks);
        for (; bits != 0; bits &= bits - 1) {
            const Index c =
                _cells.number(block.first + static_cast<std::size_t>(std::countr_zero(bits)));
            ++search.pairs_tested;
            VertexInCell pair{v, c, {}};
            if (is_in_cell(p, cell_points, _cells.cells()[at(c)], pair.weights))
                search.found.push_back(pair);
        }
    }
}

std::vector<double> VerticesInCells::voxel_sizes() const {
    std::vector<double> sizes;
    for (const double size : _cells.mean_size())
        sizes.push_back(voxel_per_block * size);
    std::sort(sizes.begin(), sizes.end());
    return sizes;
}

std::vector<VertexInCell> find_vertices_in_cells_brute_force(
    std::span<const Position> vertex_points, std::span<const Index> vertices,
    std::span<const Position> cell_points, std::span<const Cell> cells, bool is_same_body) {
    std::vector<VertexInCell> found;
    for (const Index v : vertices) {
        const Position &p = vertex_points[at(v)];
        for (std::size_t c = 0; c < cells.size(); ++c) {
            if (is_same_body && is_corner(v, cells[c]))
                continue;
            VertexInCell pair{v, static_cast<Index>(c), {}};
            if (extent_of(cell_points, cells[c]).contains(p) &&
                is_in_cell(p, cell_points, cells[c], pair.weights))
                found.push_back(pair);
        }
    }
    return found;
}

} // namespace fastsim
