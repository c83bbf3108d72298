#include "mesher/boundary_facets.hpp"

#include <algorithm>
#include <tuple>

namespace fastsim {

namespace {

// A side among those with the same smallest corner.
struct GatheredSide {
    Index middle, largest, side;
};

// So few are compared with each other.
constexpr std::size_t few = 64;

bool is_same_facet(const GatheredSide &x, const GatheredSide &y) {
    return x.middle == y.middle && x.largest == y.largest;
}

} // namespace

std::vector<Triple> find_boundary_facets(std::span<const Cell> cells, std::size_t num_points) {
    const auto facet = [&](std::size_t c, std::size_t k) -> Triple {
        const auto &f = cell_facets[k];
        const auto corner = [&](std::size_t m) { return cells[c][static_cast<std::size_t>(f[m])]; };
        return {corner(0), corner(1), corner(2)};
    };
    // The smallest corner of a cell is that of three facets, the next of the one opposite.
    std::vector<std::size_t> first(num_points + 1, 0);
    for (const Cell &c : cells) {
        const auto [low, high] = std::minmax(c[0], c[1]);
        const auto [lower, higher] = std::minmax(c[2], c[3]);
        first[TetComplex::at(std::min(low, lower)) + 1] += 3;
        ++first[TetComplex::at(low < lower ? std::min(high, lower) : std::min(low, higher)) + 1];
    }
    for (std::size_t v = 0; v < num_points; ++v)
        first[v + 1] += first[v];
    std::vector<GatheredSide> sides(4 * cells.size());
    std::vector<std::size_t> next(first.begin(), first.end() - 1);
    for (std::size_t c = 0; c < cells.size(); ++c)
        for (std::size_t k = 0; k < 4; ++k) {
            const Triple f = facet(c, k);
            const Triple t = sorted_triple(f[0], f[1], f[2]);
            sides[next[TetComplex::at(t[0])]++] = {t[1], t[2], static_cast<Index>(4 * c + k)};
        }
    std::vector<Index> single;
    std::vector<GatheredSide> open;
    for (std::size_t v = 0; v < num_points; ++v) {
        const std::span<GatheredSide> here(sides.data() + first[v], first[v + 1] - first[v]);
        if (here.size() > few)
            // Equal ones follow each other, and the last that is open is its partner.
            std::sort(here.begin(), here.end(), [](const GatheredSide &x, const GatheredSide &y) {
                return std::tie(x.middle, x.largest, x.side) <
                       std::tie(y.middle, y.largest, y.side);
            });
        open.clear();
        for (const GatheredSide &side : here) {
            std::size_t i = open.size();
            const std::size_t end = here.size() > few && i > 0 ? i - 1 : 0;
            while (i > end && !is_same_facet(open[i - 1], side))
                --i;
            if (i == end) {
                open.push_back(side);
            } else {
                open[i - 1] = open.back();
                open.pop_back();
            }
        }
        for (const GatheredSide &side : open)
            single.push_back(side.side);
    }
    std::sort(single.begin(), single.end());
    std::vector<Triple> result;
    result.reserve(single.size());
    for (const Index side : single)
        result.push_back(facet(TetComplex::at(side) / 4, TetComplex::at(side) % 4));
    return result;
}

bool is_boundary(std::span<const Triple> facets, std::span<const Cell> cells) {
    // Signed by the sense of rotation, so that the two sides of a facet inside cancel.
    const TripleHash number;
    std::uint64_t rest = 0;
    const auto add = [&](bool is_turned, std::uint64_t x) { rest += is_turned ? 0 - x : x; };
    // Puts two in order; whether that changed the sense.
    const auto order = [](Index &a, Index &b) {
        const bool is_swapped = b < a;
        const Index low = std::min(a, b);
        b = std::max(a, b);
        a = low;
        return is_swapped;
    };
    for (Cell c : cells) {
        bool is_turned = order(c[0], c[1]);
        is_turned ^= order(c[2], c[3]);
        is_turned ^= order(c[0], c[2]);
        is_turned ^= order(c[1], c[3]);
        is_turned ^= order(c[1], c[2]);
        add(is_turned, number({c[1], c[2], c[3]}) - number({c[0], c[2], c[3]}) +
                           number({c[0], c[1], c[3]}) - number({c[0], c[1], c[2]}));
    }
    for (Triple f : facets) {
        bool is_turned = order(f[0], f[1]);
        is_turned ^= order(f[1], f[2]);
        is_turned ^= order(f[0], f[1]);
        add(!is_turned, number(f));
    }
    return rest == 0;
}

} // namespace fastsim
