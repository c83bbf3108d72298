#pragma once
// Rigid tools against a body that is known by its compliance alone: one equilibrium a step.
//
// The surface that a tool may touch is a set of patches, single vertices or facets, with points q
// at which gaps are taken. A constraint i has the gap g_i = sum of s_qi g(x_q), and carries a push
// p_i along its gradient, so that with u = base + C sum p_i grad g_i
//   penalty      p = max(0, -k A g)
//   constraint   g >= 0, p >= 0, p g = 0
// (contact_sampling.py has the formulas). By Newton's method on u and p at the vertices beside
// tools, their normals' turning included (contact_term.py has the same residual): each iteration is
// a linear complementarity problem (Josephy 1979). All other points follow from the pushes.

#include "condensed/complementarity.hpp"
#include "condensed/compliance.hpp"
#include "condensed/response_columns.hpp"
#include "contact/tool_shape.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

namespace fastsim {

struct CondensedTool {
    ToolShape shape;
    double stiffness;                             // penalty k [Pa/m]
    std::vector<double> areas;                    // of the constraints [m2]
    std::vector<std::int32_t> centres;            // of each, a touched point by which it is found
    double spread;                                // how far from it its points may be [m]
    std::size_t num_corners, num_points, num_own; // of a patch: corners, points, constraints
    std::vector<std::int32_t> corners;     // of the patches, touched points; -1 for one at rest
    std::vector<Point> rest;               // of each
    std::vector<std::int32_t> constraints; // of the patches; -1 for none
    std::vector<double> shares;            // s_qi, patch by patch and point by point
    std::vector<double> shape_functions;   // of the corners at the points
};

/// On the tool, about its origin.
struct ToolLoad {
    Point force{}, moment{};
};

struct ContactOutcome {
    bool is_settled = false;
    int iterations = 0;       // Newton's, all rounds together
    std::size_t touching = 0; // constraints that push
    double error = 0.0;       // of the last iteration: gaps and displacements [m]
};

class CondensedContact {
  public:
    /// `places`: rest places of the touched points. `reach`: vertices so near to a tool are looked
    /// at from the start [m].
    CondensedContact(Compliance compliance, std::vector<Point> places,
                     std::vector<CondensedTool> tools, bool is_penalty, double reach);

    /// Equilibrium with the tools at these poses; where that is not found at once, in smaller steps
    /// from where they were. `base`: displacements of the seen points without
    /// contact. Where it does not settle, everything is as before.
    ContactOutcome step(std::span<const Pose> poses, std::span<const Point> base,
                        double relative_tolerance, int max_iterations);
    /// Forgets all contact.
    void clear();

    /// Displacements of the seen points by contact alone, and what acts on the tools.
    [[nodiscard]] std::span<const Point> response() const { return _response; }
    [[nodiscard]] std::span<const ToolLoad> loads() const { return _loads; }
    /// Forces on the touched points.
    [[nodiscard]] std::span<const Point> forces() const { return _forces; }

  private:
    struct Entry {
        std::size_t tool, constraint; // and which of the tool's
        double give;                  // 1 / (k A) [m/N]; 0 with the constraint
        double push = 0.0;
        double settled = 0.0; // push by which the normals' turning is taken
        double gap = 0.0;
        std::vector<std::size_t> points{}; // of `_points`, on which the gap depends
        std::vector<Point> gradient{};     // of the gap, by each of these
    };
    /// A constraint of a patch: its entry, -1 for none, and the corners in that one's gradient.
    struct Own {
        std::int32_t entry = -1;
        std::array<std::int32_t, 3> slots{};
    };
    /// A patch with an entry's constraint; its own constraints and the gaps at its points begin at
    /// these numbers of `_owns` and `_gaps`.
    struct Patch {
        std::size_t tool, number;
        std::array<std::int32_t, 3> corners{-1, -1, -1}; // of `_points`, -1 for one at rest
        std::size_t first_own = 0, first_gap = 0;
    };

    ContactOutcome go_to(std::span<const Pose> poses, std::span<const Point> base,
                         double relative_tolerance, int max_iterations);
    Point place_of(std::size_t touched, std::span<const Point> base) const;
    Point place_in(const Patch &patch, std::size_t point,
                   const std::array<Point, 3> &corners) const;
    std::array<Point, 3> corners_of(std::size_t tool, std::size_t patch,
                                    std::span<const Point> base) const;
    double share_of(const Patch &patch, std::size_t point, std::size_t own) const;
    double push_at(const Patch &patch, std::size_t point, double Entry::*push) const;
    double gap_of_constraint(std::size_t tool, std::size_t constraint, std::span<const Pose> poses,
                             std::span<const Point> base) const;
    bool add_near(std::span<const Pose> poses, std::span<const Point> base, double margin);
    void gather_patches();
    void gather_parts();
    double measure(std::span<const Pose> poses);
    ContactOutcome settle(std::span<const Pose> poses, std::span<const Point> base,
                          double relative_tolerance, int max_iterations);
    void turn_normals();
    bool change(std::span<const Point> residual);
    void take_over(std::span<const Pose> poses, std::span<const Point> base);

    Compliance _compliance;
    std::variant<ResponseColumns<float>, ResponseColumns<double>> _all_columns;
    std::vector<Point> _places;
    std::vector<CondensedTool> _tools;
    std::vector<Box> _boxes; // of the tools, in their own frames
    bool _is_penalty;
    double _reach;

    std::vector<std::vector<std::vector<std::int32_t>>> _patches_of; // each tool's constraints
    std::vector<std::vector<double>> _pushes;                        // of each tool's constraints
    std::vector<Point> _response, _forces;
    std::vector<ToolLoad> _loads;

    // Of the step at hand.
    std::vector<Entry> _entries;
    std::vector<Patch> _patches;
    std::vector<Own> _owns;
    std::vector<Gap> _gaps;
    std::vector<std::int32_t> _points;   // touched points of the patches
    std::vector<std::int32_t> _local;    // of each touched point among them, -1 for none
    std::vector<std::int32_t> _gathered; // whose parts of the compliance are in `_parts`
    std::vector<CompliancePart> _parts;
    std::vector<Point> _moved, _pushed; // displacement of each of `_points`, and force there
    std::vector<std::size_t> _bent;     // of `_points`, those that feel normals turn under a push
    struct Turned {
        std::size_t row; // of `_bent`
        CompliancePart part;
    };
    static void add_part(std::vector<Turned> &column, std::size_t row, double factor,
                         const CompliancePart &part);
    std::vector<std::vector<Turned>> _turning;   // D, by the columns of these at least
    std::vector<CompliancePart> _response_parts; // C D
    std::vector<double> _matrix, _columns, _bent_columns, _small, _slack, _push;
    Complementarity _complementarity;
    std::vector<Pose> _last; // where the tools were; none before the first step
};

} // namespace fastsim
