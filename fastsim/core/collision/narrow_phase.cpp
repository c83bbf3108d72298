#include "collision/narrow_phase.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>

namespace fastsim {

namespace {

// Squared sine below which a triangle or two edges are too flat to be solved for: the edges, or
// ends, decide then. The solution loses as many digits as the sine has zeros; half are left here.
constexpr double flat = 1e-16;

double squared(const Position &a) { return dot(a, a); }

/// Where on the segment from a along ab the point nearest to p is, 0 to 1.
double parameter_on(const Position &p, const Position &a, const Position &ab) {
    const double length_squared = squared(ab);
    return length_squared > 0.0 ? std::clamp(dot(minus(p, a), ab) / length_squared, 0.0, 1.0) : 0.0;
}

} // namespace

NearestOnFacet nearest_on_facet(const Position &p, const Position &a, const Position &b,
                                const Position &c) {
    const Position ab = minus(b, a), ac = minus(c, a), ap = minus(p, a);
    const Position normal = cross(ab, ac);
    const double normal_squared = squared(normal);
    if (normal_squared > flat * squared(ab) * squared(ac)) {
        const double of_b = dot(cross(ap, ac), normal) / normal_squared;
        const double of_c = dot(cross(ab, ap), normal) / normal_squared;
        const double of_a = 1.0 - of_b - of_c;
        if (of_a >= 0.0 && of_b >= 0.0 && of_c >= 0.0) {
            const Position gap = along(along(ap, ab, -of_b), ac, -of_c);
            return {{of_a, of_b, of_c}, squared(gap)};
        }
    }
    // Over a side or a corner.
    const std::array<const Position *, 3> corner{&a, &b, &c};
    NearestOnFacet nearest{{1.0, 0.0, 0.0}, squared(ap)};
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t next = (k + 1) % 3;
        const Position side = minus(*corner[next], *corner[k]);
        const double t = parameter_on(p, *corner[k], side);
        const double distance_squared = squared(along(minus(p, *corner[k]), side, -t));
        if (distance_squared < nearest.distance_squared) {
            nearest = {{0.0, 0.0, 0.0}, distance_squared};
            nearest.weights[k] = 1.0 - t;
            nearest.weights[next] = t;
        }
    }
    return nearest;
}

NearestOnEdges nearest_on_edges(const Position &a, const Position &b, const Position &c,
                                const Position &d) {
    const Position ab = minus(b, a), cd = minus(d, c), ca = minus(a, c);
    const double ab_ab = squared(ab), cd_cd = squared(cd), ab_cd = dot(ab, cd);
    const double determinant = squared(cross(ab, cd));
    if (determinant > flat * ab_ab * cd_cd) {
        const double ab_ca = dot(ab, ca), cd_ca = dot(cd, ca);
        const double s = (ab_cd * cd_ca - cd_cd * ab_ca) / determinant;
        const double t = (ab_ab * cd_ca - ab_cd * ab_ca) / determinant;
        if (s >= 0.0 && s <= 1.0 && t >= 0.0 && t <= 1.0)
            return {{s, t}, squared(along(along(ca, ab, s), cd, -t))};
    }
    // At an end of one of them.
    NearestOnEdges nearest{{0.0, 0.0}, squared(ca)};
    const auto consider = [&](double s, double t) {
        const double distance_squared = squared(along(along(ca, ab, s), cd, -t));
        if (distance_squared < nearest.distance_squared)
            nearest = {{s, t}, distance_squared};
    };
    consider(0.0, parameter_on(a, c, cd));
    consider(1.0, parameter_on(b, c, cd));
    consider(parameter_on(c, a, ab), 0.0);
    consider(parameter_on(d, a, ab), 1.0);
    return nearest;
}

} // namespace fastsim
