#pragma once
// What drives the steps of an explicit run: factors of the histories, and poses of the tools.

#include "explicit/contact.hpp"

#include <span>
#include <vector>

namespace fastsim {

/// What drives some steps: a row for the time before each, and one for the end.
struct ExplicitPlan {
    std::span<const double> factors; // one for each history
    std::span<const ToolStep> tools; // one for each tool
    std::size_t num_rows;

    std::span<const double> factors_at(std::size_t row) const {
        const std::size_t width = factors.size() / num_rows;
        return factors.subspan(row * width, width);
    }
    std::span<const ToolStep> tools_at(std::size_t row) const {
        const std::size_t width = tools.size() / num_rows;
        return tools.subspan(row * width, width);
    }
};

/// A copy of a plan, to see whether a later one begins as it does.
class RememberedPlan {
  public:
    void remember(const ExplicitPlan &plan);
    /// Bit for bit. Pre-condition: the plan has at least as many rows.
    bool begins(const ExplicitPlan &plan) const;

  private:
    std::vector<double> _factors;
    std::vector<ToolStep> _tools;
};

} // namespace fastsim
