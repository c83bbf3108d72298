#include "explicit/internal_force.hpp"

#include <algorithm>

namespace fastsim {

namespace {

template <typename Real> class PlainForce final : public InternalForce<Real> {
  public:
    PlainForce(const ElasticCells &body, StrainMeasure strain, const PointRecords &records,
               const KernelChoice<Real> &kernel, std::size_t num_threads)
        : _add_forces(kernel.add_forces), _batches(body, records, kernel.width),
          _moduli(body.materials[0]), _is_green(strain == StrainMeasure::green), _law(body.law) {
        this->portions = divide(_batches, records.size(), num_threads);
    }

    Real add(std::size_t thread, const Real *displacement, const StrainChange<Real> &change,
             Real *force) override {
        return _add_forces({displacement, change, force, _batches.corners.data(),
                            _batches.rest.data(), this->portions[thread].first_batch,
                            this->portions[thread].last_batch,
                            _batches.moduli.empty() ? nullptr : _batches.moduli.data(),
                            static_cast<Real>(_moduli.lmbda), static_cast<Real>(_moduli.mu),
                            static_cast<Real>(_moduli.c01), _is_green, _law});
    }

  private:
    ForceKernel<Real> _add_forces;
    CellBatches<Real> _batches;
    Moduli _moduli; // of the first material
    bool _is_green;
    Law _law;
};

template <typename Real> class SmoothedForce final : public InternalForce<Real> {
  public:
    SmoothedForce(const ElasticCells &body, const SmoothingPatches &patches, StrainMeasure strain,
                  const PointRecords &records, const KernelChoice<Real> &kernel,
                  std::size_t num_threads)
        : _sweep(kernel.sweep) {
        const std::vector<Index> order = cells_in_order(body.cells, records);
        const std::size_t count =
            std::max<std::size_t>(1, std::min(num_threads, order.size() / kernel.sweep_width));
        std::vector<std::uint32_t> owner(order.size());
        for (std::uint32_t t = 0; t < count; ++t)
            for (std::size_t k = order.size() * t / count; k < order.size() * (t + 1) / count; ++k)
                owner[static_cast<std::size_t>(order[k])] = t;
        for (std::uint32_t t = 0; t < count; ++t) {
            const SweepSchedule schedule(patches, order, owner, t, kernel.sweep_width);
            _plans.emplace_back(body, strain, patches, records, schedule);
            this->portions.push_back({t, t + 1, _plans[t].first_touched(), _plans[t].last_touched(),
                                      first_owned(t, count, records.size()),
                                      first_owned(t + 1, count, records.size())});
        }
    }

    Real add(std::size_t thread, const Real *displacement, const StrainChange<Real> &change,
             Real *force) override {
        return _plans[thread].run(_sweep, displacement, change, force);
    }

  private:
    SweepKernel<Real> _sweep;
    std::vector<SweepPlan<Real>> _plans; // by thread
};

/// Cell by cell in double precision on one thread, of laws that have no kernel.
template <typename Real> class ScalarForce final : public InternalForce<Real> {
  public:
    ScalarForce(const ElasticBody &body, const PointRecords &records)
        : _body(body), _records(records), _u(3 * records.size()), _f(3 * records.size()),
          _det_f(body.elastic.size()) {
        this->portions = {{0, 1, 0, records.size(), 0, records.size()}};
    }

    Real add(std::size_t, const Real *displacement, const StrainChange<Real> &,
             Real *force) override {
        _records.unpack(displacement, _u);
        std::ranges::fill(_f, 0.0);
        cell_det_f(_body.elastic, _u, _det_f);
        double least = 1.0;
        for (const double of : _det_f) // NaN counts as inverted: the comparison is false for it
            least = of > least ? least : of;
        // No law here has a stress where volume is lost.
        if (least > 0.0)
            _body.add_internal_force(_u, _f);
        for (std::size_t i = 0; i < _records.size(); ++i)
            for (std::size_t j = 0; j < 3; ++j)
                force[4 * _records.record_of[i] + j] += static_cast<Real>(_f[3 * i + j]);
        return static_cast<Real>(least);
    }

  private:
    const ElasticBody &_body;
    const PointRecords &_records;
    std::vector<double> _u, _f, _det_f;
};

} // namespace

template <typename Real>
std::unique_ptr<InternalForce<Real>>
InternalForce<Real>::make(const ElasticBody &body, StrainMeasure strain,
                          const PointRecords &records, const KernelChoice<Real> &kernel,
                          std::size_t num_threads) {
    const bool is_finite = strain == StrainMeasure::green && !body.elastic.is_linear_in_strain();
    if (is_finite && (body.patches || is_of_stretches(body.elastic.law)))
        return std::make_unique<ScalarForce<Real>>(body, records);
    if (body.patches)
        return std::make_unique<SmoothedForce<Real>>(body.elastic, *body.patches, strain, records,
                                                     kernel, num_threads);
    return std::make_unique<PlainForce<Real>>(body.elastic, strain, records, kernel, num_threads);
}

template <typename Real>
std::unique_ptr<InternalForce<Real>>
InternalForce<Real>::make_viscous(const ElasticBody &body, const PointRecords &records,
                                  const KernelChoice<Real> &kernel, std::size_t num_threads) {
    ElasticCells viscous = body.elastic;
    viscous.law = Law::saint_venant_kirchhoff;
    if (body.patches)
        return std::make_unique<SmoothedForce<Real>>(viscous, *body.patches, viscous.strain,
                                                     records, kernel, num_threads);
    return std::make_unique<PlainForce<Real>>(viscous, viscous.strain, records, kernel,
                                              num_threads);
}

template class InternalForce<float>;
template class InternalForce<double>;

} // namespace fastsim
