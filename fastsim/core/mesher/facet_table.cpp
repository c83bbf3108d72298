#include "mesher/facet_table.hpp"

#include <algorithm>
#include <tuple>

namespace fastsim {

namespace {

// So many are looked at in turn.
constexpr std::ptrdiff_t few = 12;

} // namespace

FacetTable::FacetTable(std::span<const Triple> facets) {
    Index highest = none;
    for (const Triple &f : facets)
        highest = std::max({highest, f[0], f[1], f[2]});
    // Of an empty table only the end is there.
    _first.assign(TetComplex::at(highest + 1) + 1, 0);
    for (const Triple &f : facets)
        ++_first[TetComplex::at(std::min({f[0], f[1], f[2]})) + 1];
    for (std::size_t v = 1; v < _first.size(); ++v)
        _first[v] += _first[v - 1];
    std::vector<std::size_t> next(_first.begin(), _first.end() - 1);
    _entries.resize(facets.size());
    for (std::size_t i = 0; i < facets.size(); ++i) {
        const Triple t = sorted_triple(facets[i][0], facets[i][1], facets[i][2]);
        _entries[next[TetComplex::at(t[0])]++] = {t[1], t[2], static_cast<Index>(i)};
    }
    for (std::size_t v = 0; v + 1 < _first.size(); ++v)
        std::sort(_entries.begin() + static_cast<std::ptrdiff_t>(_first[v]),
                  _entries.begin() + static_cast<std::ptrdiff_t>(_first[v + 1]),
                  [](const Entry &x, const Entry &y) {
                      return std::tie(x.middle, x.largest, x.facet) <
                             std::tie(y.middle, y.largest, y.facet);
                  });
}

Index FacetTable::search(const Triple &t) const {
    const auto is_before = [](const Entry &x, const Triple &y) {
        return x.middle < y[1] || (x.middle == y[1] && x.largest < y[2]);
    };
    const Entry *found = _entries.data() + _first[TetComplex::at(t[0])];
    const Entry *const end = _entries.data() + _first[TetComplex::at(t[0]) + 1];
    if (end - found > few)
        found = std::lower_bound(found, end, t, is_before);
    while (found != end && is_before(*found, t))
        ++found;
    return found != end && found->middle == t[1] && found->largest == t[2] ? found->facet : none;
}

} // namespace fastsim
