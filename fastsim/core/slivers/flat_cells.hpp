#pragma once
// Cells that are flat but for roundings: four corners in one plane of the surface, or in one
// where that is thinner than the roundings of its points allow to see.

#include "mesher/flips.hpp"

namespace fastsim {

/// Whether any living cell is flat, by the smallest sine of each, by slot.
bool has_flat_cell(const TetComplex &complex, std::span<const double> sines);

/// Removes flat cells by flips, or by points in cells beside them where `may_insert`. Returns
/// the number of those that stay.
std::size_t remove_flat_cells(TetComplex &complex, const Protection &protection, bool may_insert);

} // namespace fastsim
