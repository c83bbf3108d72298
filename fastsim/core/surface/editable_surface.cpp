#include "surface/editable_surface.hpp"

#include <algorithm>

namespace fastsim {

EditableSurface::EditableSurface(std::span<const Point> points, std::span<const Facet> facets)
    : _points(points.begin(), points.end()), _facets(facets.begin(), facets.end()),
      _around(points.size()), _num_sharp(points.size(), 0) {
    for (std::size_t f = 0; f < facets.size(); ++f)
        for (const Index v : facets[f])
            _around[at(v)].push_back(static_cast<Index>(f));
}

std::vector<std::pair<EditableSurface::Index, EditableSurface::Index>>
EditableSurface::edges() const {
    std::vector<std::pair<Index, Index>> out;
    for (Index v = 0; v < static_cast<Index>(_points.size()); ++v)
        for (const Index f : _around[at(v)])
            for (std::size_t k = 0; k < 3; ++k)
                // Each edge once: by its facet that runs from the smaller to the larger point.
                if (_facets[at(f)][k] == v && _facets[at(f)][(k + 1) % 3] > v)
                    out.emplace_back(v, _facets[at(f)][(k + 1) % 3]);
    std::sort(out.begin(), out.end());
    return out;
}

bool EditableSurface::has_edge(Index a, Index b) const {
    for (const Index f : _around[at(a)])
        for (const Index v : _facets[at(f)])
            if (v == b)
                return true;
    return false;
}

EditableSurface::Flaps EditableSurface::flaps(Index a, Index b) const {
    Flaps out;
    for (const Index f : _around[at(a)])
        for (std::size_t k = 0; k < 3; ++k) {
            const Index u = _facets[at(f)][k], v = _facets[at(f)][(k + 1) % 3],
                        w = _facets[at(f)][(k + 2) % 3];
            if (u == a && v == b) {
                out.left_facet = f;
                out.left = w;
            } else if (u == b && v == a) {
                out.right_facet = f;
                out.right = w;
            }
        }
    return out;
}

void EditableSurface::neighbours(Index v, std::vector<Index> &out) const {
    out.clear();
    for (const Index f : _around[at(v)])
        for (std::size_t k = 0; k < 3; ++k)
            if (_facets[at(f)][k] == v)
                out.push_back(_facets[at(f)][(k + 1) % 3]);
}

void EditableSurface::make_sharp(Index a, Index b) {
    if (_sharp.insert(key(a, b)).second) {
        ++_num_sharp[at(a)];
        ++_num_sharp[at(b)];
    }
}

void EditableSurface::forget_sharp(Index a, Index b) {
    if (_sharp.erase(key(a, b)) > 0) {
        --_num_sharp[at(a)];
        --_num_sharp[at(b)];
    }
}

void EditableSurface::detach(Index v, Index f) {
    auto &around = _around[at(v)];
    around.erase(std::find(around.begin(), around.end(), f));
}

void EditableSurface::replace_corner(Index f, Index from, Index to) {
    auto &facet = _facets[at(f)];
    *std::find(facet.begin(), facet.end(), from) = to;
    detach(from, f);
    _around[at(to)].push_back(f);
}

EditableSurface::Index EditableSurface::split(Index a, Index b, const Point &place) {
    const Flaps at_edge = flaps(a, b);
    const auto middle = static_cast<Index>(_points.size());
    _points.push_back(place);
    _around.emplace_back();
    _num_sharp.push_back(0);
    // The halves at a keep their numbers, the halves at b are new.
    for (const bool is_left : {true, false}) {
        const Index f = is_left ? at_edge.left_facet : at_edge.right_facet;
        const Index opposite = is_left ? at_edge.left : at_edge.right;
        replace_corner(f, b, middle);
        const auto added = static_cast<Index>(_facets.size());
        _facets.push_back(is_left ? Facet{middle, b, opposite} : Facet{b, middle, opposite});
        for (const Index v : {middle, b, opposite})
            _around[at(v)].push_back(added);
    }
    if (is_sharp(a, b)) {
        forget_sharp(a, b);
        make_sharp(a, middle);
        make_sharp(middle, b);
    }
    return middle;
}

bool EditableSurface::can_collapse(Index keep, Index gone) const {
    const Flaps at_edge = flaps(keep, gone);
    if (at_edge.left == at_edge.right)
        return false;
    std::vector<Index> of_keep, of_gone;
    neighbours(keep, of_keep);
    neighbours(gone, of_gone);
    // Common neighbours other than the two opposite corners would fold the surface together.
    std::size_t common = 0;
    for (const Index v : of_gone)
        common += std::find(of_keep.begin(), of_keep.end(), v) != of_keep.end();
    if (common != 2)
        return false;
    return _around[at(at_edge.left)].size() > 3 && _around[at(at_edge.right)].size() > 3;
}

void EditableSurface::collapse(Index keep, Index gone, const Point &place) {
    const Flaps at_edge = flaps(keep, gone);
    std::vector<Index> of_gone;
    neighbours(gone, of_gone);
    std::vector<Index> sharp_ends;
    for (const Index v : of_gone)
        if (is_sharp(gone, v)) {
            forget_sharp(gone, v);
            if (v != keep)
                sharp_ends.push_back(v);
        }
    for (const Index f : {at_edge.left_facet, at_edge.right_facet})
        for (const Index v : Facet(_facets[at(f)]))
            detach(v, f);
    const std::vector<Index> rest = _around[at(gone)];
    for (const Index f : rest)
        replace_corner(f, gone, keep);
    for (const Index v : sharp_ends)
        make_sharp(keep, v);
    _points[at(keep)] = place;
}

bool EditableSurface::can_flip(Index a, Index b) const {
    const Flaps at_edge = flaps(a, b);
    return at_edge.left != at_edge.right && !is_sharp(a, b) && _around[at(a)].size() > 3 &&
           _around[at(b)].size() > 3 && !has_edge(at_edge.left, at_edge.right);
}

void EditableSurface::flip(Index a, Index b) {
    const Flaps at_edge = flaps(a, b);
    // (a, b, left) and (b, a, right) become (a, right, left) and (b, left, right).
    replace_corner(at_edge.left_facet, b, at_edge.right);
    replace_corner(at_edge.right_facet, a, at_edge.left);
}

void EditableSurface::compact(std::vector<Point> &points, std::vector<Facet> &facets) const {
    points.clear();
    facets.clear();
    std::vector<Index> number(_points.size(), -1);
    std::vector<char> is_used(_facets.size(), 0);
    for (std::size_t v = 0; v < _points.size(); ++v) {
        if (_around[v].empty())
            continue;
        number[v] = static_cast<Index>(points.size());
        points.push_back(_points[v]);
        for (const Index f : _around[v])
            is_used[at(f)] = 1;
    }
    for (std::size_t f = 0; f < _facets.size(); ++f)
        if (is_used[f]) {
            Facet facet = _facets[f];
            for (Index &v : facet)
                v = number[at(v)];
            facets.push_back(facet);
        }
}

} // namespace fastsim
