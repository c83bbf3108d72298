#pragma once
// How good a cell is: by its angles, by its altitude, and by the paper's measure.

#include "mesher/tet_complex.hpp"

namespace fastsim {

/// A cell of the wanted altitude is rated as one whose smallest angle is 30 degrees.
constexpr double quality_at_wanted_altitude = 0.5;

/// Smallest sine of a dihedral angle of a cell, negative when inverted; the quality here. Where
/// the complex has a wanted altitude, a cell is no better than its smallest altitude is in parts
/// of that: small cells set the critical time step.
double cell_quality(const TetComplex &complex, const Cell &cell);

/// The same where it is above `floor`, or some value that is not above it, which takes less work.
/// `floor` is at least 0.
double cell_quality_above(const TetComplex &complex, const Cell &cell, double floor);

/// The qualities of some living cells, by slot, and whether their edge_length_deviation may be
/// above a limit: of most cells it surely isn't.
void rate_cells(const TetComplex &complex, std::span<const Index> cells, double limit,
                std::vector<double> &qualities, std::vector<char> &is_uneven);

/// The quality of all living cells, by slot; of others some number. The same of `is_uneven` where
/// it is given.
std::vector<double> cell_qualities(const TetComplex &complex, double limit = 0.0,
                                   std::vector<char> *is_uneven = nullptr);

/// No cell needs to be thinner than the thinnest facet that is given, nor thicker than a part of
/// the mean edge.
double find_wanted_altitude(const TetComplex &complex);

/// Standard deviation of a cell's edge lengths over their mean: the paper's measure.
double edge_length_deviation(const TetComplex &complex, Index c);

/// Whether that is above a limit; most cells are told by less work.
bool is_edge_length_deviation_above(const TetComplex &complex, Index c, double limit);

} // namespace fastsim
