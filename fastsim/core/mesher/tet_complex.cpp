#include "mesher/tet_complex.hpp"

#include <algorithm>
#include <stdexcept>

namespace fastsim {

Triple sorted_triple(Index a, Index b, Index c) {
    if (a > b)
        std::swap(a, b);
    if (b > c)
        std::swap(b, c);
    if (a > b)
        std::swap(a, b);
    return {a, b, c};
}

std::uint64_t edge_key(Index a, Index b) {
    const auto low = static_cast<std::uint64_t>(std::min(a, b));
    return (low << 32) | static_cast<std::uint64_t>(std::max(a, b));
}

std::size_t TripleHash::operator()(const Triple &t) const {
    std::uint64_t h = static_cast<std::uint64_t>(t[0]) * 0x9E3779B97F4A7C15ull;
    h = (h ^ (h >> 29)) + static_cast<std::uint64_t>(t[1]);
    h *= 0xBF58476D1CE4E5B9ull;
    h = (h ^ (h >> 32)) + static_cast<std::uint64_t>(t[2]);
    h *= 0x94D049BB133111EBull;
    return static_cast<std::size_t>(h ^ (h >> 31));
}

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

void TetComplex::set_cells(std::span<const Cell> cells) {
    std::unordered_map<Triple, Side, TripleHash> open;
    _fresh_cells.clear();
    for (const Cell &c : cells) {
        const Index slot_number = new_slot();
        _cells[at(slot_number)] = c;
        _fresh_cells.push_back(slot_number);
    }
    link(_fresh_cells, open);
}

Triple TetComplex::facet(Index c, int k) const {
    const Cell &v = _cells[at(c)];
    const auto &f = cell_facets[slot(k)];
    return {v[slot(f[0])], v[slot(f[1])], v[slot(f[2])]};
}

int TetComplex::corner_of(Index c, Index point) const {
    const Cell &v = _cells[at(c)];
    for (int k = 0; k < 4; ++k)
        if (v[slot(k)] == point)
            return k;
    return -1;
}

int TetComplex::orientation(const Cell &c) const {
    return orient3d(points[at(c[0])], points[at(c[1])], points[at(c[2])], points[at(c[3])]);
}

void TetComplex::link(std::span<const Index> cells,
                      std::unordered_map<Triple, Side, TripleHash> &open) {
    for (const Index c : cells) {
        for (int k = 0; k < 4; ++k) {
            const Triple f = facet(c, k);
            const Triple key = sorted_triple(f[0], f[1], f[2]);
            const auto found = open.find(key);
            if (found == open.end()) {
                _neighbours[at(c)][slot(k)] = none;
                open.emplace(key, Side{c, k});
                continue;
            }
            const Side other = found->second;
            _neighbours[at(c)][slot(k)] = other.cell;
            if (other.cell != none)
                _neighbours[at(other.cell)][slot(other.facet)] = c;
            open.erase(found);
        }
        for (const Index v : _cells[at(c)])
            _cell_of_point[at(v)] = c;
    }
}

void TetComplex::replace(std::span<const Index> dead, std::span<const Cell> fresh) {
    ++_visit_stamp;
    for (const Index c : dead)
        _visit[at(c)] = _visit_stamp;
    std::unordered_map<Triple, Side, TripleHash> open;
    open.reserve(4 * fresh.size());
    for (const Index c : dead)
        for (int k = 0; k < 4; ++k) {
            const Index n = neighbour(c, k);
            if (n != none && _visit[at(n)] == _visit_stamp)
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
            open.emplace(sorted_triple(f[0], f[1], f[2]), Side{n, back});
        }
    for (const Index c : dead) {
        _cells[at(c)] = {none, none, none, none};
        _free_slots.push_back(c);
    }
    _fresh_cells.clear();
    for (const Cell &c : fresh) {
        const Index slot_number = new_slot();
        _cells[at(slot_number)] = c;
        _fresh_cells.push_back(slot_number);
    }
    link(_fresh_cells, open);
    if (!open.empty())
        throw std::logic_error("the new cells do not fill the same space as the old ones");
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

bool TetComplex::has_edge(Index a, Index b) const {
    std::vector<Index> around;
    cells_around(a, around);
    return std::any_of(around.begin(), around.end(), [&](Index c) { return corner_of(c, b) >= 0; });
}

Side TetComplex::find_facet(Index a, Index b, Index c) const {
    std::vector<Index> around;
    cells_around(a, around);
    for (const Index t : around) {
        if (corner_of(t, b) < 0 || corner_of(t, c) < 0)
            continue;
        for (int k = 0; k < 4; ++k) {
            const Index v = _cells[at(t)][slot(k)];
            if (v != a && v != b && v != c)
                return {t, k};
        }
    }
    return {none, -1};
}

void TetComplex::edge_ring(Index a, Index b, std::vector<Index> &cells, std::vector<Index> &ring,
                           bool &is_closed) const {
    cells.clear();
    ring.clear();
    is_closed = false;
    std::vector<Index> around;
    cells_around(a, around);
    const auto found =
        std::find_if(around.begin(), around.end(), [&](Index c) { return corner_of(c, b) >= 0; });
    if (found == around.end())
        return;
    const Index start = *found;
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
