#pragma once
// Steps of several lengths in one body: cells in classes 0, 1, 2, ... that are fit for steps of h,
// b h, b^2 h, ... with b a little more than a half.
//
// A step of eq. 12 takes for the net force f(a) = F - R(a) the mean force G_1 of a step: with R_k
// of the cells of class k, L the last class,
//
//   G_(L+1)(z, f) = f
//   G_k(z, f; h)  = (G_(k+1)(z, f - R_k(z); b h) + G_(k+1)(z', f - R_k(z'); b h)) / 2
//   z'            = z + theta h^2 M^-1 G_(k+1)(z, f - R_k(z); b h)
//
// where f, at first F - R_0(a), is frozen: cells of class k are looked at 2^k times a step, those
// of class 0 once. With theta = 1/8 and b = 1/2 that is two half steps of z'' = M^-1 (f - R(z))
// from z = a, z' = 0 by central differences, of which a(t+dt) = -a(t-dt) + 2 z(dt) (Hochbruck and
// Lubich 1999; Diaz and Grote 2009, by recursion 2015). Such steps have narrow bands of
// instability, where h^2 omega^2 of the step comes to 4. The stabilized scheme (Carle and Hochbruck
// 2022) has
//
//   theta = T_2(nu) / (8 nu^2),  nu = 1 + eta^2 / 8,  T_2(nu) = 2 nu^2 - 1,
//
// and with X = h^2 omega^2 of the finer cells X (1 - theta X / 2) <= 2 + 2 / T_2(nu) of the step.
// For small strains eta = 1/2 is enough. Under Green strain stiffness changes from z to z', which
// must not bring it to 4: eta = 3/2, hence 2.88. It stays above 0 for X < 2 / theta, which the
// next class, whose step comes to 2.88 at most, keeps for b^2 > 1/4: 0.3 leaves room again.
//
// Forces of cells and contact are in pairs, and G's part of them is a mean of such: momentum is
// conserved. For small strains G = W f with M^-1 W symmetric, so that an energy is conserved too.
// For finite ones W depends on z, and energy creeps up: such motions need some damping
// (cell_classes.py says how much). A tool's penalty over facets is looked at with the last class,
// its pose as the step begins: z is the mean of the motions ahead and behind. All else that pushes
// is frozen.

#include "explicit/contact.hpp"
#include "explicit/internal_force.hpp"

#include <memory>
#include <vector>

namespace fastsim {

/// b.
double ratio_of_classes();

template <typename Real> class Multirate {
  public:
    /// Of cells in classes up to `last` >= 1; pre-conditions: those of `make_of_class`, and one
    /// thread.
    Multirate(const ElasticBody &body, const PointRecords &records,
              const KernelChoice<Real> &kernel, std::span<const Index> class_of, Index last,
              const Motion<Real> &motion);

    /// Adds R of all classes but 0; returns the smallest det F met.
    Real add_forces(Motion<Real> &motion);
    /// Puts the mean force of the step in the place of `motion.force`, once that is complete, and
    /// means in that of what tools push facets with; returns the smallest det F met.
    Real average(Motion<Real> &motion, RigidTools<Real> &tools, std::span<const ToolStep> now,
                 Push<Real> &facets);

  private:
    struct Level {
        std::unique_ptr<InternalForce<Real>> cells;
        std::size_t num_entries;         // of points of this class and finer ones, which are first
        std::vector<std::size_t> near{}; // first entries of others, which tools are near
        AlignedVector<Real> place{}, force{}, net{}, first{}; // records

        template <typename Use> void for_each_entry(const Use &use) const {
            for (std::size_t i = 0; i < num_entries; ++i)
                use(i);
            for (const std::size_t begin : near)
                for (std::size_t i = begin; i < begin + 3; ++i)
                    use(i);
        }
    };
    /// What a level needs of the one before.
    struct Task {
        const Real *place, *frozen;
        Real squared_step;
        bool is_first; // where the step begins: forces are known there
    };

    void take_points_near(RigidTools<Real> &tools, std::span<const ToolStep> now,
                          const Motion<Real> &motion);
    void find_mean(std::size_t level, const Task &task, Real *mean);
    void find_inner(std::size_t level, const Real *place, const Task &task, Real *mean);
    void touch(const Real *place);

    std::vector<Level> _levels;    // of classes 1, 2, ...
    AlignedVector<Real> _per_mass; // by entry; 0 where held
    AlignedVector<Real> _frozen, _mean;
    bool _is_smoothed; // cells of a class are strained by points of others
    Real _least = 1;
    // Of the tools in this step.
    RigidTools<Real> *_tools = nullptr;
    std::span<const ToolStep> _now;
    std::vector<std::size_t> _near;
    Motion<Real> _touching;
    Push<Real> _push;
    Push<Real> *_facets = nullptr;
    Real _part;
};

} // namespace fastsim
