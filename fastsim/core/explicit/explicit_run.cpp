#include "explicit/explicit_run.hpp"

#include "explicit/cell_forces.hpp"
#include "explicit/multirate.hpp"
#include "explicit/springs.hpp"

#include "threads/thread_team.hpp"

#include <algorithm>
#include <optional>
#include <utility>

namespace fastsim {

namespace {

template <typename Real> class Run final : public ExplicitRun {
  public:
    Run(const ElasticBody &body, std::span<const double> lumped_mass,
        std::span<const std::uint8_t> is_free, const ExplicitSettings &settings)
        : _settings(settings), _kernel(choose_kernel<Real>(settings.at_most)),
          _records(lumped_mass.size(), body.elastic.cells,
                   finest_at_points(body, settings.classes)),
          _cells(body, make_cells(body), _records, _kernel,
                 {settings.stiffness_damping, settings.scheme.time_step, settings.tracks_energy}),
          _portions(_cells.portions()), _team(_portions.size()), _at_forces(_team.size()),
          _at_end(_team.size()), _touches(_team.size()), _supports(_team.size()),
          _slides(_team.size()), _tools(_team.size()) {
        const std::size_t num_points = _records.size();
        for (auto *array : {&_motion.displacement, &_motion.increment, &_motion.external,
                            &_motion.force, &_motion.mobility})
            array->assign(_records.padded_size(), Real(0));
        if (_cells.keeps_viscous_apart())
            _motion.viscous.assign(_records.padded_size(), Real(0));
        _motion.mass.resize(num_points);
        for (std::size_t k = 0; k < num_points; ++k)
            _motion.mass[k] = lumped_mass[_records.point_of[k]];
        _motion.is_free.assign(4 * num_points, 0);
        _records.pack(is_free, _motion.is_free.data());
        _motion.set_scheme(settings.scheme);
        for (auto *push : _pushes.all())
            push->touched.resize(_team.size());
        if (!settings.classes.empty())
            _multirate.emplace(body, _records, _kernel, settings.classes,
                               std::ranges::max(settings.classes), _motion);
    }

    void set_state(std::span<const double> displacement, std::span<const double> increment,
                   double energy) override {
        forget_forces();
        _records.pack(displacement, _motion.displacement.data());
        _records.pack(increment, _motion.increment.data());
        // A held component does not move, whatever its start-up value says.
        for (std::size_t i = 0; i < _motion.is_free.size(); ++i)
            if (_motion.is_free[i] == 0)
                _motion.increment[i] = Real(0);
        _cells.start(_motion);
        _motion.has_begun = false;
        for (auto *push : _pushes.all())
            std::fill(push->force.begin(), push->force.end(), Real(0));
        _springs.reset();
        _tools.reset();
        _balance.reset(_team.size(), _motion);
        _monitor.reset(_team.size(), _motion, energy);
        _steps_since_good = 0;
        _last_factors.clear();
    }

    void get_state(std::span<double> displacement, std::span<double> increment) const override {
        _records.unpack(_motion.displacement.data(), displacement);
        _records.unpack(_motion.increment.data(), increment);
    }

    void set_dead_load(std::size_t history, std::span<const double> forces) override {
        forget_forces();
        _loads.set(_records, history, forces);
        _last_factors.clear();
    }

    void set_pressure(std::span<const double> points, std::span<const Index> facets,
                      std::span<const double> pressures,
                      std::span<const Index> histories) override {
        _pressure.set(_records, points, facets, pressures, histories, _pushes.pressure);
    }

    void set_springs(std::span<const Index> facets, std::span<const double> stiffnesses,
                     std::span<const Index> histories) override {
        forget_forces();
        _springs.set(_records, facets, stiffnesses, histories, _pushes.springs);
        _last_factors.clear();
    }

    void set_moving_supports(std::span<const double> values,
                             std::span<const Index> histories) override {
        _supports.set(_records, _portions, values, histories, _motion);
    }

    void set_sliding_supports(std::span<const Index> points, std::span<const double> directions,
                              std::span<const double> values,
                              std::span<const Index> histories) override {
        _slides.set(_records, _portions, points, directions, values, histories);
    }

    void add_tool(const TouchSettings &settings, std::span<const double> points,
                  std::span<const Index> vertices, std::span<const double> stiffnesses) override {
        _tools.add(settings, _records, points, vertices, stiffnesses);
        _pushes.tools.force.assign(4 * _records.size(), Real(0));
    }

    void add_tool_over_facets(const TouchSettings &settings, std::span<const double> points,
                              std::span<const Index> facets,
                              std::span<const double> stiffnesses) override {
        _tools.add_over_facets(settings, _records, points, facets, stiffnesses);
        _pushes.tools.force.assign(4 * _records.size(), Real(0));
        _pushes.facets.force.assign(4 * _records.size(), Real(0));
    }

    void add_constraint_over_facets(const TouchSettings &settings, std::span<const double> points,
                                    std::span<const Index> facets,
                                    std::span<const double> facet_areas,
                                    std::span<const Index> constraints,
                                    std::span<const double> areas) override {
        _tools.add_constraint_over_facets(
            settings, {_records, points, facets, facet_areas, constraints, areas});
        _pushes.tools.force.assign(4 * _records.size(), Real(0));
        _pushes.constraints.force.assign(4 * _records.size(), Real(0));
    }

    void set_self_contact(std::unique_ptr<BodyTouch> touch,
                          std::span<const double> points) override {
        _self_contact.set(std::move(touch), points);
        _pushes.body.force.assign(4 * _records.size(), Real(0));
    }

    void set_mass_damping(double mass_damping) override {
        _motion.set_scheme({_motion.scheme.time_step, mass_damping});
        if (_tools.size() > 0) // the constraint looks a step ahead
            forget_forces();
    }

    ExplicitOutcome advance(const ExplicitPlan &plan) override {
        const std::size_t num_steps = plan.num_rows - 1;
        ExplicitOutcome outcome{static_cast<std::int64_t>(num_steps), StopReason::none, -1};
        const bool is_found = has_forces_of(plan);
        if (!is_found)
            forget_forces();
        _team.run([&](std::size_t thread) {
            const auto stop = [&](StopReason reason, std::size_t steps_done) {
                if (thread == 0)
                    outcome = {static_cast<std::int64_t>(steps_done), reason, -1};
            };
            for (std::size_t step = 0; step < num_steps; ++step) {
                StopReason reason = StopReason::none;
                if (step > 0 || !is_found)
                    reason = find_forces(thread, plan, step);
                if (reason != StopReason::none)
                    return stop(reason, step);
                const bool looks = step + 1 == num_steps || step % 16 == 15;
                reason = move(thread, plan, step, looks);
                if (reason != StopReason::none)
                    return stop(reason, step + 1);
            }
        });
        _has_forces = false;
        const auto last = plan.factors_at(num_steps - 1);
        _last_factors.assign(last.begin(), last.end());
        if (outcome.reason != StopReason::none)
            go_back(outcome);
        return outcome;
    }

    ExplicitOutcome look(const ExplicitPlan &plan) override {
        ExplicitOutcome outcome{0, StopReason::none, -1};
        if (!has_forces_of(plan)) {
            forget_forces();
            _team.run([&](std::size_t thread) {
                const StopReason reason = find_forces(thread, plan, 0);
                if (thread == 0)
                    outcome.reason = reason;
                else if (reason != StopReason::none)
                    return;
                if (reason == StopReason::none && _settings.tracks_energy)
                    _balance.add(thread, _portions[thread], _motion, _pushes, _supports, _slides,
                                 false);
            });
        }
        if (outcome.reason != StopReason::none) {
            go_back(outcome);
            return outcome;
        }
        _tools.sum_reactions();
        _has_forces = true;
        _plan_of_forces.remember(plan);
        const auto now = plan.factors_at(0);
        _last_factors.assign(now.begin(), now.end());
        return outcome;
    }

    EnergyRecord energies() const override { return _balance.total(); }
    std::vector<ToolRecord> take_tool_records() override { return _tools.take_records(); }

    void get_contact_force(std::span<double> force) const override {
        for (std::size_t i = 0; i < _records.size(); ++i)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t at = 4 * _records.record_of[i] + j;
                force[3 * i + j] = _pushes.tools.at(at) + _pushes.facets.at(at) +
                                   _pushes.body.at(at) + _pushes.constraints.at(at);
            }
    }

    std::pair<std::size_t, double> self_overlap() const override { return _self_contact.overlap(); }

    void get_net_force(std::span<double> force) const override {
        for (std::size_t i = 0; i < _records.size(); ++i)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t at = 4 * _records.record_of[i] + j;
                force[3 * i + j] = static_cast<double>(_motion.external[at] - _motion.force[at]);
            }
    }

    void internal_force(std::span<double> force) override {
        forget_forces();
        _team.run([&](std::size_t thread) {
            _cells.add_elastic(thread, _motion);
            _team.wait();
            _cells.sum_elastic(thread, _motion);
        });
        if (_multirate)
            _multirate->add_forces(_motion);
        _records.unpack(_motion.force.data(), force);
        std::fill(_motion.force.begin(), _motion.force.end(), Real(0));
    }

    const char *instruction_set() const override { return _kernel.name; }

  private:
    std::unique_ptr<InternalForce<Real>> make_cells(const ElasticBody &body) const {
        if (!_settings.classes.empty())
            return InternalForce<Real>::make_of_class(body, _records, _kernel, _settings.classes,
                                                      0);
        return InternalForce<Real>::make(body, body.elastic.strain, _records, _kernel,
                                         _settings.num_threads);
    }

    struct alignas(64) Touch { // of one thread
        bool is_known = true;  // where the tools push
    };

    /// The first half of a step: the residual F - R(a) of eq. 12, with all that pushes.
    StopReason find_forces(std::size_t thread, const ExplicitPlan &plan, std::size_t step) {
        const Portion &portion = _portions[thread];
        const auto factors = plan.factors_at(step);
        Real smallest = _cells.add(thread, _motion, step == 0);
        if (_multirate) {
            const Real finer = _multirate->add_forces(_motion);
            smallest = finer > smallest ? smallest : finer;
        }
        _at_forces.cast(thread, step,
                        smallest > Real(0) ? StopReason::none : StopReason::inverted_cell);
        // Not into what was given: the other threads may still be reading that.
        if (thread == 0 && !_pressure.is_empty())
            _monitor.give_later(_pressure.add(factors, _motion, _pushes.pressure));
        if (thread == 0 && !_springs.is_empty())
            _monitor.give_later(_springs.add(factors, _motion, _pushes.springs));
        if (thread == 0 && !_self_contact.is_empty())
            _monitor.give_later(_self_contact.add(_records, _motion, _pushes.body));
        if (thread == 0 && _tools.has_facets())
            _monitor.give_later(_tools.touch_facets(plan.tools_at(step), _motion, _pushes.facets));
        _team.wait();
        if (const StopReason reason = _at_forces.result(step); reason != StopReason::none)
            return reason;
        _cells.sum(thread, _motion);
        const auto change = _loads.change(step == 0 ? std::span<const double>(_last_factors)
                                                    : plan.factors_at(step - 1),
                                          factors);
        if (change.is_jump)
            _monitor.count_dead_loads(thread, portion, _motion);
        if (change.is_new)
            _loads.combine(portion, factors, _motion);
        const auto next = plan.factors_at(step + 1);
        _monitor.give(thread, _supports.pull(thread, factors, next, _motion, _pushes));
        _monitor.give(thread, _slides.hold(thread, factors, next, _motion));
        if (_multirate &&
            !(_multirate->average(_motion, _tools, plan.tools_at(step), _pushes.facets) > Real(0)))
            return StopReason::inverted_cell;
        if (_tools.size() > 0) {
            const auto touched =
                _tools.touch(thread, portion, plan.tools_at(step), plan.tools_at(step + 1), _motion,
                             _pushes.tools, _pushes.facets);
            _touches[thread].is_known = touched.is_known;
            _monitor.give(thread, touched.given);
        }
        if (_tools.has_constraints_over_facets()) {
            _team.wait(); // all other forces are known
            if (thread == 0) {
                const auto touched = _tools.constrain(plan.tools_at(step), plan.tools_at(step + 1),
                                                      _motion, _pushes.constraints);
                _touches[0].is_known = _touches[0].is_known && touched.is_known;
                _monitor.give(0, touched.given);
            }
            _team.wait();
        }
        return StopReason::none;
    }

    /// The second half: eq. 12 itself, and a look at what came of it now and then.
    StopReason move(std::size_t thread, const ExplicitPlan &plan, std::size_t step, bool looks) {
        const Portion &portion = _portions[thread];
        if (_settings.tracks_energy)
            _balance.add(thread, portion, _motion, _pushes, _supports, _slides, true);
        // Owned points begin at whole packs; the last portion ends in the padding.
        const std::size_t last =
            (4 * portion.last_owned + longest_pack - 1) / longest_pack * longest_pack;
        const bool is_inside = _kernel.move_points(
            {_motion.displacement.data(), _motion.increment.data(), _motion.force.data(),
             _motion.external.data(), _motion.mobility.data(), 4 * portion.first_owned, last,
             _motion.keep, static_cast<Real>(_settings.displacement_limit)});
        _supports.move(thread, plan.factors_at(step + 1), _motion);
        _slides.settle(thread, plan.factors_at(step + 1), _motion);
        _at_end.cast(thread, step,
                     !is_inside                   ? StopReason::out_of_bounds
                     : !_touches[thread].is_known ? StopReason::deep_in_tool
                                                  : StopReason::none);
        if (looks)
            _monitor.look(thread, portion, _motion);
        _team.wait();
        if (thread == 0) {
            _tools.sum_reactions();
            _tools.move(plan.tools_at(step), _motion);
            _motion.has_begun = true;
            ++_steps_since_good;
        }
        if (const StopReason reason = _at_end.result(step); reason != StopReason::none)
            return reason;
        if (looks && _monitor.is_growing(_motion))
            return StopReason::energy_growth;
        if (looks) {
            _monitor.keep(portion, _motion);
            if (thread == 0)
                _steps_since_good = 0;
        }
        return StopReason::none;
    }

    /// Were the forces found for the first two rows of the plan?
    bool has_forces_of(const ExplicitPlan &plan) const {
        return _has_forces && _plan_of_forces.begins(plan);
    }

    void forget_forces() {
        if (_has_forces)
            _cells.clear(_motion);
        _has_forces = false;
    }

    /// Leaves the last good state: one step back from an inverted cell, else that of the last look
    /// of the monitor.
    void go_back(ExplicitOutcome &outcome) {
        if (outcome.reason != StopReason::inverted_cell) {
            for (std::size_t t = 0; t < _team.size(); ++t)
                _monitor.look(t, _portions[t], _motion);
            outcome.point = static_cast<std::int64_t>(_records.point_of[_monitor.fastest_record()]);
            _monitor.restore(_motion);
            outcome.steps_done -= _steps_since_good;
        } else if (_motion.has_begun) {
            for (std::size_t i = 0; i < 4 * _records.size(); ++i)
                _motion.displacement[i] -= _motion.increment[i];
            outcome.steps_done -= 1;
        }
        _last_factors.clear();
        _has_forces = true; // some
        forget_forces();
    }

    ExplicitSettings _settings;
    KernelChoice<Real> _kernel;
    PointRecords _records;
    CellForces<Real> _cells;        // of class 0, if there are several
    std::vector<Portion> _portions; // by thread
    ThreadTeam _team;
    Votes<StopReason> _at_forces, _at_end;
    std::vector<Touch> _touches;
    Motion<Real> _motion;
    std::optional<Multirate<Real>> _multirate; // one thread
    Pushes<Real> _pushes;
    DeadLoads<Real> _loads;
    FollowerPressure<Real> _pressure;
    PatchSprings<Real> _springs;
    MovingSupports<Real> _supports;
    SlidingSupports<Real> _slides;
    RigidTools<Real> _tools;
    SelfContact<Real> _self_contact;
    EnergyBalance<Real> _balance;
    EnergyMonitor<Real> _monitor;
    std::int64_t _steps_since_good = 0;
    std::vector<double> _last_factors; // that the external forces are made of; empty: other ones
    // Whether a look has left its forces for the next step, and what for.
    bool _has_forces = false;
    RememberedPlan _plan_of_forces;
};

} // namespace

// Python deletes it as if it were aligned like anything else.
static_assert(alignof(Run<double>) <= alignof(std::max_align_t));

std::unique_ptr<ExplicitRun> ExplicitRun::make(const ElasticBody &body,
                                               std::span<const double> lumped_mass,
                                               std::span<const std::uint8_t> is_free,
                                               const ExplicitSettings &settings) {
    if (settings.is_single)
        return std::make_unique<Run<float>>(body, lumped_mass, is_free, settings);
    return std::make_unique<Run<double>>(body, lumped_mass, is_free, settings);
}

} // namespace fastsim
