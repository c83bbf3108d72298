#include "collision/vertices_in_cells.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Cell = std::array<Index, 4>;

// Tried on balls of 50 000 to 3 million cells: 64 to 256 are within a tenth of each other.
constexpr std::size_t cells_in_block = 128;
// A voxel in mean sizes of a cell's box; tried from 0.5 to 2.
constexpr double voxel_per_cell = 1.0;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool is_corner(Index vertex, const Cell &cell) {
    return vertex == cell[0] || vertex == cell[1] || vertex == cell[2] || vertex == cell[3];
}

/// The bits of a 10-bit number, two apart.
std::uint32_t spread(std::uint32_t x) {
    x = (x | (x << 16)) & 0x030000ffu;
    x = (x | (x << 8)) & 0x0300f00fu;
    x = (x | (x << 4)) & 0x030c30c3u;
    return (x | (x << 2)) & 0x09249249u;
}

/// Place along Morton's curve, 1024 steps to the longest side of the box.
std::uint32_t morton_code(const Position &p, const Extent &box, double longest) {
    std::uint32_t code = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double part = longest > 0.0 ? (p[i] - box.low[i]) / longest : 0.0;
        code |= spread(static_cast<std::uint32_t>(std::clamp(part * 1023.0, 0.0, 1023.0))) << i;
    }
    return code;
}

} // namespace

CellFrame::CellFrame(std::span<const Position> points, const Cell &cell)
    : _box(extent_of(points, cell)) {
    for (std::size_t k = 0; k < 4; ++k)
        _corners[k] = &points[at(cell[k])];
}

bool CellFrame::holds(const Position &p, std::array<double, 4> &weights) {
    if (!_box.contains(p))
        return false;
    if (!_is_made) {
        const Position a = minus(*_corners[1], *_corners[0]), b = minus(*_corners[2], *_corners[0]),
                       c = minus(*_corners[3], *_corners[0]);
        _row = {cross(b, c), cross(c, a), cross(a, b)};
        const double volume = dot(a, _row[0]);
        _is_positive = volume > 0.0;
        for (Position &row : _row)
            for (double &x : row)
                x /= volume;
        _is_made = true;
    }
    if (!_is_positive)
        return false;
    const Position q = minus(p, *_corners[0]);
    for (std::size_t i = 0; i < 3; ++i)
        weights[i + 1] = dot(_row[i], q);
    weights[0] = 1.0 - weights[1] - weights[2] - weights[3];
    return weights[0] >= 0.0 && weights[1] >= 0.0 && weights[2] >= 0.0 && weights[3] >= 0.0;
}

VerticesInCells::VerticesInCells(std::span<const Position> cell_points, std::span<const Cell> cells,
                                 std::span<const Index> vertices, bool is_same_body)
    : _vertices(vertices.begin(), vertices.end()), _hash(vertices.size()),
      _is_same_body(is_same_body) {
    std::vector<double> sizes;
    sizes.reserve(cells.size());
    for (const Cell &cell : cells)
        sizes.push_back(extent_of(cell_points, cell).longest());
    const SizeClasses classes = sort_by_size(sizes);
    for (const double mean : classes.mean)
        _voxel_sizes.push_back(voxel_per_cell * mean);
    make_blocks(cell_points, cells, classes);
    _active.reserve(vertices.size());
    _found.reserve(vertices.size() + 64); // grows, once, where more are found
}

void VerticesInCells::make_blocks(std::span<const Position> points, std::span<const Cell> cells,
                                  const SizeClasses &classes) {
    const Extent all = extent_of_all(points);
    const double longest = all.longest();
    std::vector<std::pair<std::uint64_t, Index>> order;
    order.reserve(cells.size());
    for (std::size_t c = 0; c < cells.size(); ++c) {
        const Extent box = extent_of(points, cells[c]);
        Position middle;
        for (std::size_t i = 0; i < 3; ++i)
            middle[i] = 0.5 * box.low[i] + 0.5 * box.high[i];
        order.emplace_back(std::uint64_t{classes.of[c]} << 32 | morton_code(middle, all, longest),
                           static_cast<Index>(c));
    }
    std::sort(order.begin(), order.end());
    for (const auto &[key, c] : order) {
        _number.push_back(c);
        _cells.push_back(cells[at(c)]);
    }
    std::vector<Index> own;
    for (std::size_t first = 0; first < _cells.size();) {
        const std::size_t size_class = classes.of[at(_number[first])];
        std::size_t last = first;
        own.clear();
        while (last < _cells.size() && last < first + cells_in_block &&
               classes.of[at(_number[last])] == size_class) {
            own.insert(own.end(), _cells[last].begin(), _cells[last].end());
            ++last;
        }
        std::sort(own.begin(), own.end());
        own.erase(std::unique(own.begin(), own.end()), own.end());
        const std::size_t begin = _block_points.size();
        _block_points.insert(_block_points.end(), own.begin(), own.end());
        _blocks.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last),
                           static_cast<std::uint32_t>(begin),
                           static_cast<std::uint32_t>(_block_points.size()), size_class});
        first = last;
    }
    _block_points.shrink_to_fit();
}

std::span<const VertexInCell> VerticesInCells::find(std::span<const Position> vertex_points,
                                                    std::span<const Position> cell_points) {
    _found.clear();
    _work = {};
    // Only vertices in the box of all cells count, and only cells that meet the box of those.
    const Extent body = extent_of_all(cell_points);
    if (!extent_of_some(vertex_points, _vertices).meets(body))
        return _found;
    _active.clear();
    Extent near = Extent::nothing();
    for (const Index v : _vertices)
        if (const Position &p = vertex_points[at(v)]; body.contains(p)) {
            _active.push_back(v);
            near.add(p);
        }
    std::size_t filled = _voxel_sizes.size(); // class that the table is for now
    for (const Block &block : _blocks) {
        Extent box = Extent::nothing();
        for (std::size_t k = block.first_point; k < block.last_point; ++k)
            box.add(cell_points[at(_block_points[k])]);
        if (!box.meets(near))
            continue;
        if (filled != block.size_class) {
            filled = block.size_class; // blocks of a class follow one another
            _hash.fill(_active, near, _voxel_sizes[filled],
                       [&](Index v) -> const Position & { return vertex_points[at(v)]; });
            _work.hashed += _active.size();
        }
        if (_hash.may_hold(box))
            look_into(block, vertex_points, cell_points);
    }
    std::sort(_found.begin(), _found.end());
    return _found;
}

void VerticesInCells::look_into(const Block &block, std::span<const Position> vertex_points,
                                std::span<const Position> cell_points) {
    _work.cells_near += block.last_cell - block.first_cell;
    for (std::size_t c = block.first_cell; c < block.last_cell; ++c) {
        CellFrame frame(cell_points, _cells[c]);
        _hash.near(frame.box(), [&](const VoxelHash::Entry &entry, std::size_t) {
            if (_is_same_body && is_corner(entry.id, _cells[c]))
                return;
            ++_work.pairs_tested;
            VertexInCell pair{entry.id, _number[c], {}};
            if (frame.holds(vertex_points[at(entry.id)], pair.weights))
                _found.push_back(pair);
        });
    }
}

std::vector<double> VerticesInCells::voxel_sizes() const {
    return {_voxel_sizes.rbegin(), _voxel_sizes.rend()};
}

std::vector<VertexInCell> find_vertices_in_cells_brute_force(
    std::span<const Position> vertex_points, std::span<const Index> vertices,
    std::span<const Position> cell_points, std::span<const Cell> cells, bool is_same_body) {
    std::vector<VertexInCell> found;
    for (std::size_t c = 0; c < cells.size(); ++c) {
        CellFrame frame(cell_points, cells[c]);
        for (const Index v : vertices) {
            VertexInCell pair{v, static_cast<Index>(c), {}};
            if (is_same_body && is_corner(v, cells[c]))
                continue;
            if (frame.holds(vertex_points[at(v)], pair.weights))
                found.push_back(pair);
        }
    }
    std::sort(found.begin(), found.end());
    return found;
}

} // namespace fastsim
