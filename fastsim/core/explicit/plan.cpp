#include "explicit/plan.hpp"

#include <cstring>

namespace fastsim {

namespace {

template <typename T> bool same_bytes(std::span<const T> a, const std::vector<T> &b) {
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

} // namespace

void RememberedPlan::remember(const ExplicitPlan &plan) {
    _factors.assign(plan.factors.begin(), plan.factors.end());
    _tools.assign(plan.tools.begin(), plan.tools.end());
}

bool RememberedPlan::begins(const ExplicitPlan &plan) const {
    return same_bytes(plan.factors.first(_factors.size()), _factors) &&
           same_bytes(plan.tools.first(_tools.size()), _tools);
}

} // namespace fastsim
