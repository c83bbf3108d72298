#pragma once
// A point put into a tetrahedralisation where flips are stuck: the cells around its place are
// taken out and the hole is filled with cells to the point, each positive by the exact predicate.

#include "mesher/flips.hpp"

namespace fastsim {

/// Inserts point `s`, whose place is set, into the cells of `cavity`, grown by those whose facets
/// it does not see strictly from inside, or makes a cell worse than `least_quality` with. Refuses,
/// changing nothing, when a protected edge or facet or another point would be lost, or the cavity
/// grows beyond bounds.
bool insert_star(TetComplex &complex, const Protection &protection, std::vector<Index> cavity,
                 Index s, double least_quality);

} // namespace fastsim
