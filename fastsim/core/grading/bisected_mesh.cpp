#include "grading/bisected_mesh.hpp"

#include <algorithm>
#include <tuple>

namespace fastsim {

namespace {

using Index = BisectedMesh::Index;
using Cell = BisectedMesh::Cell;

/// Whether a permutation of four is odd.
bool is_odd(const std::array<int, 4> &p) {
    int swaps = 0;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j)
            swaps += p[i] > p[j];
    return swaps % 2 == 1;
}

} // namespace

BisectedMesh::BisectedMesh(std::span<const Point> points, std::span<const Cell> cells,
                           std::span<const Cell> facet_tags)
    : _points(points.begin(), points.end()), _parents(points.size(), {-1, -1}),
      _given(cells.begin(), cells.end()), _cut_in_sweep(points.size(), 0) {
    _nodes.reserve(2 * cells.size());
    for (std::size_t c = 0; c < cells.size(); ++c)
        _nodes.push_back(marked_root(cells[c], facet_tags[c]));
}

BisectedMesh::Node BisectedMesh::marked_root(const Cell &cell, const Cell &tags) const {
    // Any strict order of all edges marks facets the same way from both sides; the longest first
    // gives the best shapes. Both cells compute a length from the same end.
    const auto rank = [&](int i, int j) {
        const Index a = std::min(cell[at(i)], cell[at(j)]), b = std::max(cell[at(i)], cell[at(j)]);
        double squared = 0.0;
        for (std::size_t k = 0; k < 3; ++k) {
            const double d = _points[at(b)][k] - _points[at(a)][k];
            squared += d * d;
        }
        return std::tuple(squared, a, b);
    };
    std::array<int, 4> order{0, 1, 2, 3};
    for (int i = 0; i < 4; ++i)
        for (int j = i + 1; j < 4; ++j)
            if (rank(order[0], order[1]) < rank(i, j)) {
                order[0] = i;
                order[1] = j;
            }
    for (int i = 0, next = 2; i < 4; ++i)
        if (i != order[0] && i != order[1])
            order[at(next++)] = i;
    Node node;
    for (std::size_t k = 0; k < 4; ++k) {
        node.corner[k] = cell[at(order[k])];
        node.facet_tag[k] = tags[at(order[k])];
    }
    for (std::size_t s = 0; s < 2; ++s) {
        const auto one = rank(order[s], order[2]), two = rank(order[s], order[3]),
                   far = rank(order[2], order[3]);
        node.marked[s] = far > one && far > two ? 2 : (two > one ? 1 : 0);
    }
    node.is_mirrored = is_odd(order);
    return node;
}

void BisectedMesh::bisect(Index number) {
    const Node parent = _nodes[at(number)];
    const Index a = parent.corner[0], b = parent.corner[1];
    Index middle = _middles.find(a, b);
    if (middle < 0) {
        middle = static_cast<Index>(_points.size());
        Point p;
        for (std::size_t k = 0; k < 3; ++k)
            p[k] = 0.5 * (_points[at(a)][k] + _points[at(b)][k]);
        _points.push_back(p);
        _parents.push_back({std::min(a, b), std::max(a, b)});
        _middles.insert(a, b, middle);
        _cut_in_sweep.push_back(0);
        _cut_in_sweep[at(a)] = _cut_in_sweep[at(b)] = _sweep;
    }
    const bool is_second_planar = is_planar(parent) && parent.is_flagged;
    const Index c = parent.corner[2], d = parent.corner[3];
    const Cell &tag = parent.facet_tag;
    const auto first = static_cast<Index>(_nodes.size());
    for (std::size_t s = 0; s < 2; ++s) {
        const Index keep = parent.corner[s];
        const std::uint8_t code = parent.marked[s];
        // Facets of the child: the parent's own (opposite the middle), the halves of its facets
        // opposite c and d, and the new one between the two children (opposite `keep`).
        const Index own = tag[1 - s], of_c = tag[2], of_d = tag[3];
        Node child;
        child.parent = number;
        child.generation = static_cast<std::uint16_t>(parent.generation + 1);
        child.is_flagged = is_planar(parent) && !parent.is_flagged;
        child.is_mirrored = parent.is_mirrored != ((s == 1) != (code == 0));
        // The own facet's marked edge becomes the refinement edge. A half facet's marked edge is
        // the one opposite the middle; so is the new facet's, but after the second planar
        // generation it is the one from the middle to the new refinement edge.
        const std::uint8_t of_new = is_second_planar ? 0 : 1;
        switch (code) {
        case 0:
            child.corner = {keep, c, middle, d};
            child.facet_tag = {-1, of_c, own, of_d};
            child.marked[0] = 1;
            child.marked[1] = of_new;
            break;
        case 1:
            child.corner = {keep, d, middle, c};
            child.facet_tag = {-1, of_d, own, of_c};
            child.marked[0] = 1;
            child.marked[1] = of_new;
            break;
        default:
            child.corner = {c, d, keep, middle};
            child.facet_tag = {of_c, of_d, -1, own};
            child.marked[0] = 0;
            child.marked[1] = 0;
            break;
        }
        _nodes.push_back(child);
    }
    _nodes[at(number)].child = first;
}

bool BisectedMesh::has_cut_edge(const Cell &corner) const {
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j)
            if (_cut_in_sweep[at(corner[i])] >= _first_sweep &&
                _cut_in_sweep[at(corner[j])] >= _first_sweep &&
                _middles.find(corner[i], corner[j]) >= 0)
                return true;
    return false;
}

void BisectedMesh::refine(std::span<const std::uint8_t> marked) {
    const std::vector<Index> leaf = leaf_numbers();
    std::vector<Index> todo;
    for (std::size_t k = leaf.size(); k-- > 0;)
        if (marked[k])
            todo.push_back(leaf[k]);
    _first_sweep = ++_sweep;
    while (!todo.empty()) {
        // Depth first: a child that holds a cut edge is bisected at once.
        while (!todo.empty()) {
            const Index number = todo.back();
            todo.pop_back();
            if (_nodes[at(number)].child >= 0)
                continue;
            bisect(number);
            const Index child = _nodes[at(number)].child;
            for (const Index k : {child + 1, child})
                if (has_cut_edge(_nodes[at(k)].corner))
                    todo.push_back(k);
        }
        // Cells that were there before and now hold a hanging point: both ends of its edge were
        // touched, one of them in this sweep at the latest.
        for (std::size_t n = _nodes.size(); n-- > 0;) {
            const Node &node = _nodes[n];
            if (node.child >= 0)
                continue;
            int touched = 0;
            for (const Index v : node.corner)
                touched += _cut_in_sweep[at(v)] == _sweep;
            if (touched > 1 && has_cut_edge(node.corner))
                todo.push_back(static_cast<Index>(n));
        }
        ++_sweep;
    }
}

std::vector<Index> BisectedMesh::leaf_numbers() const {
    std::vector<Index> out, todo;
    out.reserve(_nodes.size() / 2 + _given.size());
    for (std::size_t root = 0; root < _given.size(); ++root) {
        todo.assign(1, static_cast<Index>(root));
        while (!todo.empty()) {
            const Index n = todo.back();
            todo.pop_back();
            const Index child = _nodes[at(n)].child;
            if (child < 0) {
                out.push_back(n);
            } else {
                todo.push_back(child + 1);
                todo.push_back(child);
            }
        }
    }
    return out;
}

BisectedMesh::Leaves BisectedMesh::leaves() const {
    const std::vector<Index> leaf = leaf_numbers();
    Leaves out;
    out.cells.reserve(leaf.size());
    out.facet_tags.reserve(leaf.size());
    out.given_cell.reserve(leaf.size());
    out.generation.reserve(leaf.size());
    for (const Index n : leaf) {
        const Node &node = _nodes[at(n)];
        Index root = n;
        while (_nodes[at(root)].parent >= 0)
            root = _nodes[at(root)].parent;
        Cell cell = node.corner, tags = node.facet_tag;
        if (node.is_mirrored) {
            std::swap(cell[2], cell[3]);
            std::swap(tags[2], tags[3]);
        }
        if (node.parent < 0) {
            // A given cell keeps the order of its corners.
            Cell sorted_tags{};
            for (std::size_t k = 0; k < 4; ++k)
                for (std::size_t j = 0; j < 4; ++j)
                    if (_given[at(root)][k] == cell[j])
                        sorted_tags[k] = tags[j];
            cell = _given[at(root)];
            tags = sorted_tags;
        }
        out.cells.push_back(cell);
        out.facet_tags.push_back(tags);
        out.given_cell.push_back(root);
        out.generation.push_back(node.generation);
    }
    return out;
}

} // namespace fastsim
