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

/// The paper's threshold of edge_length_deviation, which it does not print. A flat square scores
/// 0.19 and passes: the angle finds it. A needle whose angles are fair is found by this.
constexpr double largest_deviation = 0.45;

/// What cells are worth, by slot; of one that does not live some number.
struct CellRatings {
    std::vector<double> sines;     // the smallest of a cell's angles
    std::vector<double> qualities; // by altitude too
    std::vector<double> steps;     // as cell_step
    std::vector<char> is_uneven;   // 0 where edge_length_deviation surely is below its threshold
};

/// All cells, with an altitude that is wanted, or 0.
CellRatings rate_all_cells(const TetComplex &complex, double wanted_altitude);
/// Some living cells anew, with the complex's altitude.
void rate_cells(const TetComplex &complex, std::span<const Index> cells, CellRatings &ratings);

/// No cell needs to be thinner than the thinnest facet that is given, nor thicker than a part of
/// the mean edge.
double find_wanted_altitude(const TetComplex &complex);

/// Standard deviation of a cell's edge lengths over their mean: the paper's measure.
double edge_length_deviation(const TetComplex &complex, Index c);

/// Whether that is above a limit; most cells are told by less work.
bool is_edge_length_deviation_above(const TetComplex &complex, Index c, double limit);

} // namespace fastsim
