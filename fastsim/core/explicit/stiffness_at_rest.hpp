#pragma once
// K x of a body at rest without its matrix, by the explicit step's kernels: for smoothed cells the
// matrix is four times as large as that of plain ones, and takes longer to make than to do without.

#include "explicit/internal_force.hpp"

namespace fastsim {

class StiffnessAtRest {
  public:
    /// Pre-conditions: positive cells; every point in a cell.
    StiffnessAtRest(const ElasticBody &body, InstructionSet at_most)
        : _records(body.points.size() / 3, body.elastic.cells),
          _force(InternalForce<double>::make(body, StrainMeasure::linear, _records,
                                             choose_kernel<double>(at_most), 1)),
          _x(_records.padded_size(), 0.0), _y(_records.padded_size(), 0.0) {}

    std::size_t num_points() const { return _records.size(); }

    /// Three numbers a point.
    void multiply(std::span<const double> x, std::span<double> y) {
        _records.pack(x, _x.data());
        std::fill(_y.begin(), _y.end(), 0.0);
        _force->add(0, _x.data(), {}, _y.data());
        _records.unpack(_y.data(), y);
    }

  private:
    PointRecords _records;
    std::unique_ptr<InternalForce<double>> _force;
    AlignedVector<double> _x, _y;
};

} // namespace fastsim
