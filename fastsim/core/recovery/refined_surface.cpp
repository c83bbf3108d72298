#include "recovery/refined_surface.hpp"

#include <algorithm>

namespace fastsim {

void RefinedSurface::add(const Triple &t, Index parent) {
    const auto number = static_cast<Index>(_triangles.size());
    _triangles.push_back(t);
    _parents.push_back(parent);
    for (std::size_t k = 0; k < 3; ++k) {
        auto &two =
            _sides.try_emplace(edge_key(t[k], t[(k + 1) % 3]), std::array<Index, 2>{none, none})
                .first->second;
        (two[0] == none ? two[0] : two[1]) = number;
        _triangle_of_point[t[k]] = number;
    }
}

void RefinedSurface::remove(Index t) {
    Triple &f = _triangles[TetComplex::at(t)];
    for (std::size_t k = 0; k < 3; ++k) {
        const auto found = _sides.find(edge_key(f[k], f[(k + 1) % 3]));
        auto &two = found->second;
        (two[0] == t ? two[0] : two[1]) = none;
        if (two[0] == none && two[1] == none)
            _sides.erase(found);
    }
    // A point that stays gets one of the new triangles.
    for (const Index v : f)
        if (const auto known = _triangle_of_point.find(v);
            known != _triangle_of_point.end() && known->second == t)
            _triangle_of_point.erase(known);
    f = {none, none, none};
}

std::vector<Index> RefinedSurface::fan(Index s, std::vector<Index> &link) const {
    link.clear();
    std::vector<Index> around;
    const auto found = _triangle_of_point.find(s);
    if (found == _triangle_of_point.end())
        return around;
    Index t = found->second;
    do {
        const Triple &f = _triangles[TetComplex::at(t)];
        const auto corner = std::find(f.begin(), f.end(), s);
        if (corner == f.end() || around.size() == _triangles.size())
            return {};
        const auto k = static_cast<std::size_t>(corner - f.begin());
        around.push_back(t);
        link.push_back(f[(k + 1) % 3]);
        const std::array<Index, 2> two = _sides.at(edge_key(s, f[(k + 2) % 3]));
        t = two[0] == t ? two[1] : two[0];
        if (t == none)
            return {};
    } while (t != found->second);
    return around;
}

void RefinedSurface::replace(std::span<const Index> dead, std::span<const Triple> fresh,
                             std::span<const Index> parents) {
    for (const Index t : dead)
        remove(t);
    for (std::size_t i = 0; i < fresh.size(); ++i)
        add(fresh[i], parents[i]);
}

std::vector<Triple> RefinedSurface::triangles() const {
    std::vector<Triple> result;
    for (const Triple &t : _triangles)
        if (t[0] != none)
            result.push_back(t);
    return result;
}

} // namespace fastsim
