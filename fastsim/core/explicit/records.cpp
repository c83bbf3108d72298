#include "explicit/records.hpp"

#include "explicit/renumber.hpp"

#include <algorithm>
#include <numeric>

namespace fastsim {

PointRecords::PointRecords(std::size_t num_points, std::span<const Index> cells)
    : PointRecords(num_points, cells, std::vector<Index>(num_points, 0)) {}

PointRecords::PointRecords(std::size_t num_points, std::span<const Index> cells,
                           std::span<const Index> class_of_points)
    : record_of(num_points), point_of(num_points) {
    std::vector<Index> order = reverse_cuthill_mckee(num_points, cells);
    std::ranges::stable_sort(order, std::ranges::greater{}, [&](Index point) {
        return class_of_points[static_cast<std::size_t>(point)];
    });
    for (std::size_t k = 0; k < order.size(); ++k) {
        point_of[k] = static_cast<std::size_t>(order[k]);
        record_of[point_of[k]] = k;
    }
}

std::vector<Index> cells_in_order(std::span<const Index> cells, const PointRecords &records) {
    std::vector<std::size_t> key(cells.size() / 4, 0);
    for (std::size_t i = 0; i < cells.size(); ++i)
        key[i / 4] += records.first_entry(cells[i]);
    std::vector<Index> order(key.size());
    std::iota(order.begin(), order.end(), Index{0});
    std::ranges::stable_sort(order, {}, [&](Index c) { return key[static_cast<std::size_t>(c)]; });
    return order;
}

std::size_t first_owned(std::size_t thread, std::size_t num_threads, std::size_t num_points) {
    constexpr std::size_t whole = longest_pack / 4;
    return thread == num_threads ? num_points : num_points * thread / num_threads / whole * whole;
}

template <typename Real>
CellBatches<Real>::CellBatches(const ElasticCells &body, const PointRecords &records,
                               std::size_t kernel_width)
    : width(kernel_width), count((body.size() + width - 1) / width) {
    const std::size_t num_cells = body.size();
    const std::vector<Index> &cells = body.cells;
    const std::vector<Index> sorted = cells_in_order(cells, records);
    corners.assign(4 * width * count, static_cast<std::int32_t>(4 * records.size()));
    rest.assign(10 * width * count, Real(0));
    if (body.materials.size() > 1)
        moduli.assign(3 * width * count, Real(0));
    for (std::size_t k = 0; k < num_cells; ++k) {
        const std::size_t c = static_cast<std::size_t>(sorted[k]), batch = k / width,
                          lane = k % width;
        for (std::size_t a = 0; a < 4; ++a)
            corners[(4 * batch + a) * width + lane] =
                static_cast<std::int32_t>(records.first_entry(cells[4 * c + a]));
        for (std::size_t e = 0; e < 9; ++e)
            rest[(10 * batch + e) * width + lane] = static_cast<Real>(body.rest.gradients[c][e]);
        rest[(10 * batch + 9) * width + lane] = static_cast<Real>(body.rest.volumes[c]);
        if (moduli.empty())
            continue;
        const Moduli &own = body.moduli_of(c);
        moduli[3 * batch * width + lane] = static_cast<Real>(own.lmbda);
        moduli[(3 * batch + 1) * width + lane] = static_cast<Real>(own.mu);
        moduli[(3 * batch + 2) * width + lane] = static_cast<Real>(own.c01);
    }
}

template <typename Real>
std::vector<Portion> divide(const CellBatches<Real> &batches, std::size_t num_points,
                            std::size_t num_threads) {
    const std::size_t count = std::max<std::size_t>(1, std::min(num_threads, batches.count));
    std::vector<Portion> portions;
    for (std::size_t t = 0; t < count; ++t) {
        Portion portion{
            batches.count * t / count,         batches.count * (t + 1) / count,      num_points, 0,
            first_owned(t, count, num_points), first_owned(t + 1, count, num_points)};
        const std::size_t size = 4 * batches.width;
        for (std::size_t i = size * portion.first_batch; i < size * portion.last_batch; ++i) {
            const auto point = static_cast<std::size_t>(batches.corners[i]) / 4;
            if (point == num_points)
                continue;
            portion.first_touched = std::min(portion.first_touched, point);
            portion.last_touched = std::max(portion.last_touched, point + 1);
        }
        portions.push_back(portion);
    }
    return portions;
}

template struct CellBatches<float>;
template struct CellBatches<double>;
template std::vector<Portion> divide(const CellBatches<float> &, std::size_t, std::size_t);
template std::vector<Portion> divide(const CellBatches<double> &, std::size_t, std::size_t);

} // namespace fastsim
