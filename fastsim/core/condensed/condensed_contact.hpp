#pragma once
// Rigid tools against a body that is known by its compliance alone: one equilibrium a step.
//
// Each vertex beside a tool carries a push p along the tool's normal n, with the gap g where the
// vertex is, so that with u = base + C sum p n
//   penalty      p = max(0, -k A g)
//   constraint   g >= 0, p >= 0, p g = 0
// By Newton's method on u and p at the vertices beside tools, their normals' turning included
// (contact_term.py has the same residual): each iteration is a linear complementarity problem
// (Josephy 1979). All other points follow from the pushes.

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
    double stiffness;                   // penalty k [Pa/m]
    std::vector<std::int32_t> vertices; // that may touch, numbers among the touched points
    std::vector<double> areas;          // of each [m2]
};

/// On the tool, about its origin.
struct ToolLoad {
    Point force{}, moment{};
};

struct ContactOutcome {
    bool is_settled = false;
    int iterations = 0;       // Newton's, all rounds together
    std::size_t touching = 0; // vertices that are pushed
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
        std::size_t tool, vertex; // and which of the tool's
        std::size_t local;        // row in the small system
        double give;              // 1 / (k A) [m/N]; 0 with the constraint
        double push = 0.0;
        double settled = 0.0; // push by which the normal's turning is taken
        Gap gap{0.0, {}};
    };

    ContactOutcome go_to(std::span<const Pose> poses, std::span<const Point> base,
                         double relative_tolerance, int max_iterations);
    Point place_of(std::size_t touched, std::span<const Point> base) const;
    bool add_near(std::span<const Pose> poses, std::span<const Point> base, double margin);
    void gather_parts();
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

    std::vector<std::vector<double>> _pushes; // of each tool's vertices
    std::vector<Point> _response, _forces;
    std::vector<ToolLoad> _loads;

    // Of the step at hand.
    std::vector<Entry> _entries;
    std::vector<std::int32_t> _points;   // touched points of the entries
    std::vector<std::int32_t> _local;    // of each touched point among them, -1 for none
    std::vector<std::int32_t> _gathered; // whose parts of the compliance are in `_parts`
    std::vector<CompliancePart> _parts;
    std::vector<Point> _moved, _pushed;   // displacement of each of `_points`, and force there
    std::vector<std::size_t> _bent;       // of `_points`, those whose normals turn under a push
    std::vector<CompliancePart> _turning; // D of each of these
    std::vector<double> _matrix, _columns, _bent_columns, _small, _slack, _push;
    Complementarity _complementarity;
    std::vector<Pose> _last; // where the tools were; none before the first step
};

} // namespace fastsim
