#include "collision/vertices_in_cells.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <limits>
#include <map>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Cell = std::array<Index, 4>;

bool is_corner(Index vertex, const Cell &cell) {
    return vertex == cell[0] || vertex == cell[1] || vertex == cell[2] || vertex == cell[3];
}

/// Box of some vertices; low above high when there are none.
Extent extent_of(std::span<const Position> points, std::span<const Index> vertices) {
    constexpr double far = std::numeric_limits<double>::infinity();
    Extent box{{far, far, far}, {-far, -far, -far}};
    for (const Index v : vertices)
        for (std::size_t i = 0; i < 3; ++i) {
            box.low[i] = std::min(box.low[i], points[static_cast<std::size_t>(v)][i]);
            box.high[i] = std::max(box.high[i], points[static_cast<std::size_t>(v)][i]);
        }
    return box;
}

} // namespace

CellFrame::CellFrame(std::span<const Position> points, const Cell &cell) {
    for (std::size_t k = 0; k < 4; ++k)
        _corners[k] = &points[static_cast<std::size_t>(cell[k])];
    _box = {*_corners[0], *_corners[0]};
    for (std::size_t k = 1; k < 4; ++k)
        for (std::size_t i = 0; i < 3; ++i) {
            _box.low[i] = std::min(_box.low[i], (*_corners[k])[i]);
            _box.high[i] = std::max(_box.high[i], (*_corners[k])[i]);
        }
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
    : _vertices(vertices.begin(), vertices.end()), _is_same_body(is_same_body) {
    // A voxel as large as the largest box of its class: a cell touches two to each side at most.
    std::map<int, std::vector<Index>> by_size;
    for (std::size_t c = 0; c < cells.size(); ++c) {
        const Extent box = CellFrame(cell_points, cells[c]).box();
        double longest = std::numeric_limits<double>::min();
        for (std::size_t i = 0; i < 3; ++i)
            longest = std::max(longest, box.high[i] - box.low[i]);
        by_size[std::ilogb(longest)].push_back(static_cast<Index>(c));
    }
    for (auto &[exponent, members] : by_size) {
        std::vector<Cell> corners;
        corners.reserve(members.size());
        for (const Index c : members)
            corners.push_back(cells[static_cast<std::size_t>(c)]);
        _classes.push_back({std::move(members), std::move(corners),
                            VertexHash(vertices.size(), std::ldexp(1.0, exponent + 1))});
    }
}

std::span<const VertexInCell> VerticesInCells::find(std::span<const Position> vertex_points,
                                                    std::span<const Position> cell_points) {
    _found.clear();
    _work = {};
    // Beyond which sides of the vertices' box is each point? A cell whose corners are all beyond
    // the same side is passed over without a look at their places.
    const Extent all = extent_of(vertex_points, _vertices);
    _side.resize(cell_points.size());
    for (std::size_t v = 0; v < cell_points.size(); ++v) {
        unsigned side = 0;
        for (std::size_t i = 0; i < 3; ++i)
            side |= (cell_points[v][i] < all.low[i] ? 1u : 0u) << (2 * i) |
                    (cell_points[v][i] > all.high[i] ? 2u : 0u) << (2 * i);
        _side[v] = static_cast<std::uint8_t>(side);
    }
    const auto side_of = [&](Index v) { return _side[static_cast<std::size_t>(v)]; };
    for (SizeClass &one : _classes) {
        _work.rehashed += one.hash.update(vertex_points, _vertices);
        for (std::size_t c = 0; c < one.cells.size(); ++c) {
            const Cell &cell = one.cells[c];
            if (side_of(cell[0]) & side_of(cell[1]) & side_of(cell[2]) & side_of(cell[3]))
                continue;
            ++_work.cells_near;
            CellFrame frame(cell_points, cell);
            const auto test = [&](Index k) {
                const Index v = _vertices[static_cast<std::size_t>(k)];
                if (_is_same_body && is_corner(v, cell))
                    return;
                ++_work.pairs_tested;
                VertexInCell pair{v, one.number[c], {}};
                if (frame.holds(vertex_points[static_cast<std::size_t>(v)], pair.weights))
                    _found.push_back(pair);
            };
            // A cell drawn out far beyond its class would touch more voxels than there are
            // vertices.
            if (one.hash.count_voxels(frame.box()) > static_cast<double>(_vertices.size()) + 8.0)
                for (std::size_t k = 0; k < _vertices.size(); ++k)
                    test(static_cast<Index>(k));
            else
                one.hash.near(frame.box(), test);
        }
    }
    std::sort(_found.begin(), _found.end());
    return _found;
}

std::vector<double> VerticesInCells::voxel_sizes() const {
    std::vector<double> sizes;
    for (const SizeClass &one : _classes)
        sizes.push_back(one.hash.voxel_size());
    return sizes;
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
            if (frame.holds(vertex_points[static_cast<std::size_t>(v)], pair.weights))
                found.push_back(pair);
        }
    }
    std::sort(found.begin(), found.end());
    return found;
}

} // namespace fastsim
