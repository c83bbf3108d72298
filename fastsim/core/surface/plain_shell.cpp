#include "surface/plain_shell.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace fastsim {
namespace {

using Index = std::int32_t;
using Facet = std::array<Index, 3>;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

// Facets at one point are compared with each other.
constexpr std::size_t most_in_fan = 64;
// Of the sum of what facets add to the volume: its roundings are a ten-thousandth of it for a
// milliard facets.
constexpr double least_share = 1e-3;

// A facet at one of its corners: the other two, in its sense of rotation.
struct Spoke {
    Index next, previous;
};

// Whether the facets around a point are one closed fan: then each of its edges has two facets that
// run along it in opposite directions. With two facets they lie on each other.
bool is_fan(std::span<const Spoke> spokes) {
    if (spokes.size() < 3 || spokes.size() > most_in_fan) {
        return false;
    }
    const Index first = spokes[0].next;
    Index here = first;
    for (std::size_t turn = 0; turn < spokes.size(); ++turn) {
        const auto spoke = std::find_if(spokes.begin(), spokes.end(),
                                        [&](const Spoke &s) { return s.next == here; });
        if (spoke == spokes.end() || (turn > 0 && here == first)) {
            return false;
        }
        here = spoke->previous;
    }
    return here == first;
}

} // namespace

bool is_plain_shell(std::span<const Point> points, std::span<const Facet> facets) {
    if (facets.empty()) {
        return false;
    }
    Point centre{};
    for (const Point &p : points) {
        for (std::size_t i = 0; i < 3; ++i) {
            centre[i] += p[i] / static_cast<double>(points.size());
        }
    }
    std::vector<std::size_t> first(points.size() + 1, 0);
    double volume = 0.0, sum = 0.0;
    for (const Facet &f : facets) {
        const Point &a = points[at(f[0])], &b = points[at(f[1])], &c = points[at(f[2])];
        Point u, v;
        double ab = 0.0, ac = 0.0, bc = 0.0;
        for (std::size_t i = 0; i < 3; ++i) {
            u[i] = b[i] - a[i];
            v[i] = c[i] - a[i];
            ab += u[i] * u[i];
            ac += v[i] * v[i];
            bc += (c[i] - b[i]) * (c[i] - b[i]);
        }
        const Point normal{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                           u[0] * v[1] - u[1] * v[0]};
        double squared = 0.0, height = 0.0;
        for (std::size_t i = 0; i < 3; ++i) {
            squared += normal[i] * normal[i];
            height += normal[i] * (a[i] - centre[i]);
        }
        // Twice as strict as the long look, so that no rounding lets a facet through.
        if (!(std::sqrt(squared) >
              8.0 * std::numeric_limits<double>::epsilon() * std::max({ab, ac, bc}))) {
            return false;
        }
        volume += height;
        sum += std::abs(height);
        for (const Index corner : f) {
            ++first[at(corner) + 1];
        }
    }
    if (!(volume > least_share * sum)) {
        return false;
    }
    for (std::size_t p = 0; p < points.size(); ++p) {
        first[p + 1] += first[p];
    }
    std::vector<Spoke> spokes(3 * facets.size());
    std::vector<std::size_t> next(first.begin(), first.end() - 1);
    for (const Facet &f : facets) {
        for (std::size_t k = 0; k < 3; ++k) {
            spokes[next[at(f[k])]++] = {f[(k + 1) % 3], f[(k + 2) % 3]};
        }
    }
    const auto spokes_of = [&](std::size_t p) {
        return std::span<const Spoke>(spokes).subspan(first[p], first[p + 1] - first[p]);
    };
    std::size_t num_used = 0;
    for (std::size_t p = 0; p < points.size(); ++p) {
        const std::span<const Spoke> around = spokes_of(p);
        if (around.empty()) {
            continue;
        }
        ++num_used;
        if (!is_fan(around)) {
            return false;
        }
    }
    // One shell: all points that facets use are reached from one of them.
    std::vector<char> is_reached(points.size(), 0);
    std::vector<Index> reached{facets[0][0]};
    reached.reserve(num_used);
    is_reached[at(reached[0])] = 1;
    for (std::size_t i = 0; i < reached.size(); ++i) {
        for (const Spoke &s : spokes_of(at(reached[i]))) {
            if (!is_reached[at(s.next)]) {
                is_reached[at(s.next)] = 1;
                reached.push_back(s.next);
            }
        }
    }
    return reached.size() == num_used;
}

} // namespace fastsim
