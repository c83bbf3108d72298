#include "explicit/internal_force.hpp"

#include <algorithm>
#include <array>
#include <limits>

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
        plan(body, patches, strain, records, kernel, order, owner, count);
    }

    /// The cells of the owner 0 alone, on one thread.
    SmoothedForce(const ElasticCells &body, const SmoothingPatches &patches, StrainMeasure strain,
                  const PointRecords &records, const KernelChoice<Real> &kernel,
                  std::span<const std::uint32_t> owner)
        : _sweep(kernel.sweep) {
        plan(body, patches, strain, records, kernel, cells_in_order(body.cells, records), owner, 1);
    }

    Real add(std::size_t thread, const Real *displacement, const StrainChange<Real> &change,
             Real *force) override {
        return _plans[thread].run(_sweep, displacement, change, force);
    }

  private:
    void plan(const ElasticCells &body, const SmoothingPatches &patches, StrainMeasure strain,
              const PointRecords &records, const KernelChoice<Real> &kernel,
              std::span<const Index> order, std::span<const std::uint32_t> owner,
              std::size_t count) {
        for (std::uint32_t t = 0; t < count; ++t) {
            const SweepSchedule schedule(patches, order, owner, t, kernel.sweep_width);
            _plans.emplace_back(body, strain, patches, records, schedule);
            this->portions.push_back({t, t + 1, _plans[t].first_touched(), _plans[t].last_touched(),
                                      first_owned(t, count, records.size()),
                                      first_owned(t + 1, count, records.size())});
        }
    }

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

namespace {

/// The finest class of the cells that name each group.
std::vector<Index> finest_of_groups(std::span<const Index> table, std::size_t width,
                                    std::size_t num_groups, std::span<const Index> class_of) {
    std::vector<Index> finest(num_groups, 0);
    for (std::size_t i = 0; i < table.size(); ++i) {
        Index &known = finest[static_cast<std::size_t>(table[i])];
        known = std::max(known, class_of[i / width]);
    }
    return finest;
}

struct PatchClasses {
    std::vector<Index> edges, nodes;

    PatchClasses(const SmoothingPatches &patches, std::span<const Index> class_of)
        : edges(finest_of_groups(patches.cell_edges, 6, patches.num_edges(), class_of)),
          nodes(finest_of_groups(patches.cell_nodes, 4, patches.num_nodes(), class_of)) {}

    /// Those of a cell's ten patches.
    std::array<Index, 10> of(const SmoothingPatches &patches, std::size_t cell) const {
        std::array<Index, 10> found{};
        for (std::size_t k = 0; k < 6; ++k)
            found[k] = edges[static_cast<std::size_t>(patches.cell_edges[6 * cell + k])];
        for (std::size_t k = 0; k < 4; ++k)
            found[6 + k] = nodes[static_cast<std::size_t>(patches.cell_nodes[4 * cell + k])];
        return found;
    }
};

/// Those cells of a body that are of a class.
ElasticCells cells_of_class(const ElasticCells &body, std::span<const Index> class_of,
                            Index number) {
    ElasticCells part{{}, {}, body.materials, {}, body.strain, body.law, body.ogden_terms};
    for (std::size_t c = 0; c < body.size(); ++c)
        if (class_of[c] == number) {
            part.cells.insert(part.cells.end(), &body.cells[4 * c], &body.cells[4 * c] + 4);
            part.rest.gradients.push_back(body.rest.gradients[c]);
            part.rest.volumes.push_back(body.rest.volumes[c]);
            part.material_of.push_back(body.material_of[c]);
        }
    return part;
}

} // namespace

std::vector<Index> finest_at_cells(const ElasticBody &body, std::span<const Index> class_of) {
    std::vector<Index> finest(class_of.begin(), class_of.end());
    if (!body.patches)
        return finest;
    const PatchClasses classes(*body.patches, class_of);
    for (std::size_t c = 0; c < finest.size(); ++c)
        finest[c] = std::ranges::max(classes.of(*body.patches, c));
    return finest;
}

std::vector<Index> finest_at_points(const ElasticBody &body, std::span<const Index> class_of) {
    if (class_of.empty())
        return std::vector<Index>(body.points.size() / 3, 0);
    const std::vector<Index> cells = finest_at_cells(body, class_of);
    return finest_of_groups(body.elastic.cells, 4, body.points.size() / 3, cells);
}

template <typename Real>
std::unique_ptr<InternalForce<Real>>
InternalForce<Real>::make_of_class(const ElasticBody &body, const PointRecords &records,
                                   const KernelChoice<Real> &kernel,
                                   std::span<const Index> class_of, Index number) {
    const ElasticCells &all = body.elastic;
    if (!body.patches)
        return std::make_unique<PlainForce<Real>>(cells_of_class(all, class_of, number), all.strain,
                                                  records, kernel, 1);
    const PatchClasses classes(*body.patches, class_of);
    std::vector<std::uint32_t> owner(all.size(), 1);
    for (std::size_t c = 0; c < all.size(); ++c)
        if (std::ranges::count(classes.of(*body.patches, c), number) > 0)
            owner[c] = 0;
    // Strains and pressures are weighed by 1 / volume: those of other classes weigh nothing.
    constexpr double endless = std::numeric_limits<double>::infinity();
    SmoothingPatches own = *body.patches;
    for (std::size_t e = 0; e < own.num_edges(); ++e)
        if (classes.edges[e] != number)
            own.edge_volume[e] = endless;
    for (std::size_t n = 0; n < own.num_nodes(); ++n)
        if (classes.nodes[n] != number)
            own.node_volume[n] = endless;
    return std::make_unique<SmoothedForce<Real>>(all, own, all.strain, records, kernel, owner);
}

template class InternalForce<float>;
template class InternalForce<double>;

} // namespace fastsim
