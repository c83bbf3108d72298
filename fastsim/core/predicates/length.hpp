#pragma once

#include <cmath>

namespace fastsim {

/// Length of a vector: quicker than std::hypot, which is asked only where squares may leave the
/// range of numbers.
inline double length_of(double x, double y, double z) {
    const double squared = x * x + y * y + z * z;
    return squared > 1e-280 && squared < 1e280 ? std::sqrt(squared) : std::hypot(x, y, z);
}

} // namespace fastsim
