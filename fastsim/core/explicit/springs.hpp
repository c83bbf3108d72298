#pragma once
// Springs over patches of the surface: sum over the corners b of a facet of K_ab (d - u_b) on its
// corner a, d the displacement of the spring's anchor.

#include "explicit/motion.hpp"

#include <span>

namespace fastsim {

template <typename Real> class PatchSprings {
  public:
    /// In the place of those before; see `ExplicitRun::set_springs`.
    void set(const PointRecords &records, std::span<const Index> facets,
             std::span<const double> stiffnesses, std::span<const Index> histories,
             Push<Real> &push);
    bool is_empty() const { return _histories.empty(); }

    /// Renews the push and takes it off the forces; returns what moving the anchors has put into
    /// the springs since the last time, or all that they hold at the first.
    double add(std::span<const double> factors, Motion<Real> &motion, Push<Real> &push);
    /// What comes next is the first time.
    void reset() { _last_factors.clear(); }

  private:
    double energy(std::span<const double> factors, const Motion<Real> &motion) const;

    std::vector<double> _last_factors;
    std::vector<std::size_t> _corners; // first entries, three for each facet
    std::vector<Real> _stiffnesses;    // nine for each
    std::vector<Index> _histories;     // the first of four
};

} // namespace fastsim
