// What an explicit run is made of: layout, masses, loads and supports. See explicit_run.hpp.
#include "mechanics/explicit_run.hpp"

#include "mechanics/renumber.hpp"

#include <algorithm>
#include <cstddef>
#include <numeric>

namespace fastsim {

template <typename Real>
ExplicitRun<Real>::ExplicitRun(std::span<const double> points, std::span<const Index> cells,
                               std::span<const double> lumped_mass,
                               std::span<const std::uint8_t> is_free,
                               const ExplicitSettings &settings)
    : _settings(settings), _kernel(choose_kernel<Real>(settings.at_most)),
      _num_points(points.size() / 3), _record_of(_num_points), _point_of(_num_points) {
    const std::vector<Index> order = reverse_cuthill_mckee(_num_points, cells);
    for (std::size_t k = 0; k < order.size(); ++k)
        _record_of[static_cast<std::size_t>(order[k])] = k;
    for (std::size_t i = 0; i < _num_points; ++i)
        _point_of[_record_of[i]] = i;
    for (auto *array : {&_displacement, &_increment, &_external, &_mobility})
        array->assign(padded_size(), Real(0));
    _mass.assign(_num_points, 0.0);
    for (std::size_t i = 0; i < _num_points; ++i)
        _mass[_record_of[i]] = lumped_mass[i];
    _total_mass = std::accumulate(_mass.begin(), _mass.end(), 0.0);
    _points.assign(4 * _num_points, Real(0));
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _points[4 * _record_of[i] + j] = static_cast<Real>(points[3 * i + j]);
    _limit = static_cast<Real>(settings.displacement_limit);
    _is_free.assign(4 * _num_points, 0);
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j)
            _is_free[4 * _record_of[i] + j] = is_free[3 * i + j];
    set_mobility();
    lay_out_cells(points, cells);
    share_out();
}

template <typename Real>
void ExplicitRun<Real>::lay_out_cells(std::span<const double> points,
                                      std::span<const Index> cells) {
    const std::size_t num_cells = cells.size() / 4;
    const std::size_t width = _kernel.width;
    const RestCells rest = make_rest_cells(points, cells);
    std::vector<std::size_t> first(num_cells), sorted(num_cells);
    for (std::size_t c = 0; c < num_cells; ++c) {
        std::size_t sum = 0;
        for (std::size_t a = 0; a < 4; ++a)
            sum += _record_of[static_cast<std::size_t>(cells[4 * c + a])];
        first[c] = sum;
    }
    std::iota(sorted.begin(), sorted.end(), std::size_t{0});
    std::stable_sort(sorted.begin(), sorted.end(),
                     [&](std::size_t a, std::size_t b) { return first[a] < first[b]; });
    _num_batches = (num_cells + width - 1) / width;
    _records.assign(4 * width * _num_batches, static_cast<std::int32_t>(4 * _num_points));
    _rest.assign(10 * width * _num_batches, Real(0));
    for (std::size_t k = 0; k < num_cells; ++k) {
        const std::size_t c = sorted[k], batch = k / width, lane = k % width;
        for (std::size_t a = 0; a < 4; ++a)
            _records[(4 * batch + a) * width + lane] = static_cast<std::int32_t>(
                4 * _record_of[static_cast<std::size_t>(cells[4 * c + a])]);
        for (std::size_t e = 0; e < 9; ++e)
            _rest[(10 * batch + e) * width + lane] = static_cast<Real>(rest.gradients[c][e]);
        _rest[(10 * batch + 9) * width + lane] = static_cast<Real>(rest.volumes[c]);
    }
}

template <typename Real> void ExplicitRun<Real>::share_out() {
    const std::size_t num_threads =
        std::max<std::size_t>(1, std::min(_settings.num_threads, _num_batches));
    const std::size_t per_batch = 4 * _kernel.width;
    _shares.resize(num_threads);
    for (std::size_t t = 0; t < num_threads; ++t) {
        Share &share = _shares[t];
        share.first_batch = _num_batches * t / num_threads;
        share.last_batch = _num_batches * (t + 1) / num_threads;
        const auto begin =
            _records.begin() + static_cast<std::ptrdiff_t>(per_batch * share.first_batch);
        const auto end =
            _records.begin() + static_cast<std::ptrdiff_t>(per_batch * share.last_batch);
        share.first_touched = _num_points;
        share.last_touched = 0;
        for (auto it = begin; it != end; ++it) {
            const auto point = static_cast<std::size_t>(*it) / 4;
            if (point == _num_points)
                continue;
            share.first_touched = std::min(share.first_touched, point);
            share.last_touched = std::max(share.last_touched, point + 1);
        }
        share.force.assign(padded_size(), Real(0));
        const auto boundary = [&](std::size_t k) {
            constexpr std::size_t whole = longest_pack / 4;
            return k == num_threads ? _num_points : _num_points * k / num_threads / whole * whole;
        };
        share.first_owned = boundary(t);
        share.last_owned = boundary(t + 1);
    }
}

template <typename Real> void ExplicitRun<Real>::set_mobility() {
    const double dt = _settings.time_step, half_damping = 0.5 * _settings.mass_damping * dt;
    _keep = static_cast<Real>((1.0 - half_damping) / (1.0 + half_damping));
    for (std::size_t i = 0; i < 4 * _num_points; ++i)
        if (_is_free[i] != 0)
            _mobility[i] = static_cast<Real>(dt * dt / (_mass[i / 4] * (1.0 + half_damping)));
}

template <typename Real> void ExplicitRun<Real>::set_mass_damping(double mass_damping) {
    _settings.mass_damping = mass_damping;
    set_mobility();
}

template <typename Real>
void ExplicitRun<Real>::set_state(std::span<const double> displacement,
                                  std::span<const double> increment, double energy) {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t at = 4 * _record_of[i] + j;
            _displacement[at] = static_cast<Real>(displacement[3 * i + j]);
            // A held component does not move, whatever its start-up value says.
            _increment[at] = _is_free[at] != 0 ? static_cast<Real>(increment[3 * i + j]) : Real(0);
        }
    _good_displacement = _worked_displacement = _displacement;
    _good_increment = _increment;
    _steps_since_good = 0;
    _energy_at_start = energy;
    _has_begun = false;
    rest_tools();
    for (Share &share : _shares)
        share.work = share.loss = share.given = share.pressure_work = 0.0;
}

template <typename Real>
void ExplicitRun<Real>::get_state(std::span<double> displacement,
                                  std::span<double> increment) const {
    for (std::size_t i = 0; i < _num_points; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            const std::size_t at = 4 * _record_of[i] + j;
            displacement[3 * i + j] = static_cast<double>(_displacement[at]);
            increment[3 * i + j] = static_cast<double>(_increment[at]);
        }
}

template <typename Real>
void ExplicitRun<Real>::set_dead_loads(std::span<const double> forces, std::size_t num_histories) {
    _dead_loads.assign(num_histories, std::vector<double>(4 * _num_points, 0.0));
    for (std::size_t k = 0; k < num_histories; ++k)
        for (std::size_t i = 0; i < _num_points; ++i)
            for (std::size_t j = 0; j < 3; ++j)
                _dead_loads[k][4 * _record_of[i] + j] = forces[3 * (_num_points * k + i) + j];
    _loaded.clear();
    for (std::size_t k = 0; k < num_histories; ++k)
        if (std::ranges::any_of(_dead_loads[k], [](double f) { return f != 0.0; }))
            _loaded.push_back(k);
}

template <typename Real>
void ExplicitRun<Real>::set_pressure(std::span<const Index> facets,
                                     std::span<const double> pressures,
                                     std::span<const Index> histories) {
    _pressed.clear();
    for (const Index i : facets)
        _pressed.push_back(4 * _record_of[static_cast<std::size_t>(i)]);
    _pressures.assign(pressures.begin(), pressures.end());
    _pressure_histories.assign(histories.begin(), histories.end());
    _pressure_force.assign(_pressures.empty() ? 0 : 4 * _num_points, Real(0));
    _pressed_entries.clear();
    for (const std::size_t first : _pressed)
        for (std::size_t j = 0; j < 3; ++j)
            _pressed_entries.push_back(first + j);
    std::sort(_pressed_entries.begin(), _pressed_entries.end());
    _pressed_entries.erase(std::unique(_pressed_entries.begin(), _pressed_entries.end()),
                           _pressed_entries.end());
}

template <typename Real>
void ExplicitRun<Real>::set_moving_supports(std::span<const double> values,
                                            std::span<const Index> histories) {
    for (Share &share : _shares) {
        share.moving.clear();
        for (std::size_t k = share.first_owned; k < share.last_owned; ++k)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t from = 3 * _point_of[k] + j;
                if (histories[from] >= 0)
                    share.moving.push_back({4 * k + j, static_cast<std::size_t>(histories[from]),
                                            values[from], _mass[k]});
            }
    }
}

template class ExplicitRun<float>;
template class ExplicitRun<double>;

} // namespace fastsim
