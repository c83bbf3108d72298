#include "mesher/tet_complex.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace fastsim {

void TetComplex::add_point(const Point &point) {
    points.push_back(point);
    _cell_of_point.push_back(none);
}

Index TetComplex::new_slot() {
    if (!_free_slots.empty()) {
        const Index c = _free_slots.back();
        _free_slots.pop_back();
        return c;
    }
    _cells.push_back({none, none, none, none});
    _neighbours.push_back({none, none, none, none});
    _visit.push_back(0);
    return static_cast<Index>(_cells.size() - 1);
}

void TetComplex::add_points(std::span<const Point> more) {
    points.insert(points.end(), more.begin(), more.end());
    _cell_of_point.resize(points.size(), none);
}

void TetComplex::set_cells(std::vector<Cell> cells, std::vector<Cell> neighbours) {
    _cells = std::move(cells);
    _neighbours = std::move(neighbours);
    _visit.assign(_cells.size(), 0);
    for (std::size_t c = 0; c < _cells.size(); ++c)
        for (const Index v : _cells[c])
            _cell_of_point[at(v)] = static_cast<Index>(c);
}

int TetComplex::orientation(const Cell &c) const {
    return orient3d(points[at(c[0])], points[at(c[1])], points[at(c[2])], points[at(c[3])]);
}

// Links new cells among each other and to the sides left open around them.
void TetComplex::link(std::span<const Index> cells) {
    for (const Index c : cells) {
        for (int k = 0; k < 4; ++k) {
            const Triple f = facet(c, k);
            const Triple key = sorted_triple(f[0], f[1], f[2]);
            // A change has few sides: a search from the last is quicker than a hash table.
            std::size_t i = _open.size();
            while (i > 0 && !TripleHash::is_same(_open[i - 1].key, key))
                --i;
            if (i == 0) {
                _neighbours[at(c)][slot(k)] = none;
                _open.push_back({key, {c, k}});
                continue;
            }
            const Side other = _open[i - 1].side;
            _neighbours[at(c)][slot(k)] = other.cell;
            if (other.cell != none)
                _neighbours[at(other.cell)][slot(other.facet)] = c;
            _open[i - 1] = _open.back();
            _open.pop_back();
        }
        for (const Index v : _cells[at(c)])
            _cell_of_point[at(v)] = c;
    }
}

void TetComplex::replace(std::span<const Index> dead, std::span<const Cell> fresh,
                         bool may_change_boundary) {
    ++_visit_stamp;
    for (const Index c : dead)
        _visit[at(c)] = _visit_stamp;
    _open.clear();
    for (const Index c : dead)
        for (int k = 0; k < 4; ++k) {
            const Index n = neighbour(c, k);
            if (n != none && _visit[at(n)] == _visit_stamp)
                continue;
            if (n == none && may_change_boundary)
                continue;
            const Triple f = facet(c, k);
            int back = -1;
            if (n != none)
                for (int m = 0; m < 4; ++m)
                    if (neighbour(n, m) == c) {
                        const Triple g = facet(n, m);
                        if (sorted_triple(g[0], g[1], g[2]) == sorted_triple(f[0], f[1], f[2]))
                            back = m;
                    }
            _open.push_back({sorted_triple(f[0], f[1], f[2]), {n, back}});
        }
    std::vector<Index> dead_corners;
    for (const Index c : dead) {
        if (may_change_boundary)
            dead_corners.insert(dead_corners.end(), _cells[at(c)].begin(), _cells[at(c)].end());
        _cells[at(c)] = {none, none, none, none};
        _free_slots.push_back(c);
    }
    _fresh_cells.clear();
    for (const Cell &c : fresh) {
        const Index slot_number = new_slot();
        _cells[at(slot_number)] = c;
        _fresh_cells.push_back(slot_number);
    }
    link(_fresh_cells);
    if (may_change_boundary)
        close_boundary(dead_corners);
    else if (!_open.empty())
        throw std::logic_error("the new cells do not fill the same space as the old ones");
}

void TetComplex::close_boundary(std::span<const Index> corners) {
    const auto is_lost = [&](Index v) {
        const Index c = cell_at(v);
        return c == none || corner_of(c, v) < 0;
    };
    // What found no partner is boundary now.
    for (const auto &[key, side] : _open) {
        _neighbours[at(side.cell)][slot(side.facet)] = none;
        for (const Index v : key)
            if (is_lost(v))
                _cell_of_point[at(v)] = side.cell;
    }
    for (const Index v : corners)
        if (is_lost(v))
            _cell_of_point[at(v)] = none;
}

void TetComplex::cells_around(Index point, std::vector<Index> &out) const {
    out.clear();
    const Index start = cell_at(point);
    if (start == none)
        return;
    ++_visit_stamp;
    out.push_back(start);
    _visit[at(start)] = _visit_stamp;
    for (std::size_t i = 0; i < out.size(); ++i) {
        const Index c = out[i];
        for (int k = 0; k < 4; ++k) {
            if (_cells[at(c)][slot(k)] == point)
                continue;
            const Index n = neighbour(c, k);
            if (n != none && _visit[at(n)] != _visit_stamp) {
                _visit[at(n)] = _visit_stamp;
                out.push_back(n);
            }
        }
    }
}

template <typename Fits> Index TetComplex::first_around(Index point, const Fits &fits) const {
    const Index start = cell_at(point);
    if (start == none || fits(start))
        return start;
    ++_visit_stamp;
    thread_local std::vector<Index> around; // kept for its memory
    around.assign(1, start);
    _visit[at(start)] = _visit_stamp;
    for (std::size_t i = 0; i < around.size(); ++i) {
        const Index c = around[i];
        for (int k = 0; k < 4; ++k) {
            if (_cells[at(c)][slot(k)] == point)
                continue;
            const Index n = neighbour(c, k);
            if (n == none || _visit[at(n)] == _visit_stamp)
                continue;
            if (fits(n))
                return n;
            _visit[at(n)] = _visit_stamp;
            around.push_back(n);
        }
    }
    return none;
}

bool TetComplex::has_edge(Index a, Index b) const {
    return first_around(a, [&](Index c) { return corner_of(c, b) >= 0; }) != none;
}

Side TetComplex::find_facet(Index a, Index b, Index c) const {
    const Index t =
        first_around(a, [&](Index n) { return corner_of(n, b) >= 0 && corner_of(n, c) >= 0; });
    if (t != none)
        for (int k = 0; k < 4; ++k) {
            const Index v = _cells[at(t)][slot(k)];
            if (v != a && v != b && v != c)
                return {t, k};
        }
    return {none, -1};
}

void TetComplex::edge_ring(Index a, Index b, std::vector<Index> &cells, std::vector<Index> &ring,
                           bool &is_closed) const {
    cells.clear();
    ring.clear();
    is_closed = false;
    const Index found = first_around(a, [&](Index c) { return corner_of(c, b) >= 0; });
    if (found != none)
        edge_ring_from(found, a, b, cells, ring, is_closed);
}

void TetComplex::edge_ring_from(Index start, Index a, Index b, std::vector<Index> &cells,
                                std::vector<Index> &ring, bool &is_closed) const {
    cells.clear();
    ring.clear();
    is_closed = false;
    Index others[2] = {none, none};
    int count = 0;
    for (const Index v : cell(start))
        if (v != a && v != b)
            others[count++] = v;
    Index from = others[0], to = others[1], c = start;
    do {
        cells.push_back(c);
        ring.push_back(from);
        const Index next = neighbour(c, corner_of(c, from)); // across facet (a, b, to)
        if (next == none)
            return;
        Index beyond = none;
        for (const Index v : cell(next))
            if (v != a && v != b && v != to)
                beyond = v;
        c = next;
        from = to;
        to = beyond;
    } while (c != start);
    is_closed = true;
}

} // namespace fastsim
