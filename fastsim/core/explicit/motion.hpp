#pragma once
// A body in motion as all parts of an explicit run see it, in records (see records.hpp).

#include "explicit/records.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

namespace fastsim {

template <typename Real> struct Motion {
    CentralDifference scheme;
    AlignedVector<Real> displacement, increment; // a(t), and d(t) = a(t) - a(t-dt)
    AlignedVector<Real> external;                // F: the dead loads
    AlignedVector<Real> force;    // R(a), less what pushes besides the dead loads; 0 after a step
    AlignedVector<Real> mobility; // 0 where held
    AlignedVector<Real> viscous;  // part of `force`; only where the balance of energy asks for it
    std::vector<double> mass;     // by point
    std::vector<std::uint8_t> is_free; // by entry
    Real keep;
    bool has_begun = false; // a step has been made from the state that was set

    /// d(t+dt) of an entry by eq. 12, before the step makes it.
    Real increment_ahead(std::size_t i) const {
        return next_increment(keep, increment[i], mobility[i], external[i] - force[i]);
    }
    void set_scheme(const CentralDifference &given) {
        scheme = given;
        keep = static_cast<Real>(scheme.keep());
        for (std::size_t i = 0; i < is_free.size(); ++i)
            if (is_free[i] != 0)
                mobility[i] = static_cast<Real>(scheme.mobility(mass[i / 4]));
    }
};

/// What pushes besides the dead loads, in records; empty where nothing ever does.
template <typename Real> struct Push {
    AlignedVector<Real> force;
    std::vector<std::vector<std::size_t>> touched; // by thread: records that may not be 0

    /// Makes room for all records; it acts on those that begin at these entries, from one thread.
    void act_on(const std::vector<std::size_t> &entries, std::size_t num_records) {
        force.assign(4 * num_records, Real(0));
        std::vector<std::size_t> &mine = touched[0] = entries;
        std::ranges::sort(mine);
        mine.erase(std::ranges::unique(mine).begin(), mine.end());
    }

    /// Sets it to 0; returns the work that it did along the last increment.
    double clear(std::size_t thread, const Motion<Real> &motion) {
        double work = 0.0;
        for (const std::size_t first : touched[thread])
            for (std::size_t i = first; i < first + 3; ++i) {
                // What pushes a moving support passes straight through it.
                if (motion.is_free[i] != 0)
                    work +=
                        static_cast<double>(force[i]) * static_cast<double>(motion.increment[i]);
                force[i] = Real(0);
            }
        return work;
    }
    double at(std::size_t i) const { return force.empty() ? 0.0 : static_cast<double>(force[i]); }
};

template <typename Real> struct Pushes {
    // Facets: of tools' penalties on these. Constraints: of tools on facets, a step ahead.
    Push<Real> pressure, springs, body, facets, tools, constraints;

    std::array<Push<Real> *, 6> all() {
        return {&pressure, &springs, &body, &facets, &tools, &constraints};
    }
    /// Of those that do not depend on what is ahead [N].
    double before_tools(std::size_t i) const {
        return pressure.at(i) + springs.at(i) + body.at(i) + facets.at(i);
    }
    double total(std::size_t i) const { return before_tools(i) + tools.at(i) + constraints.at(i); }
};

} // namespace fastsim
