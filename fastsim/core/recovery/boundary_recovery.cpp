#include "recovery/boundary_recovery.hpp"

#include "recovery/flip_recovery.hpp"
#include "recovery/steiner_recovery.hpp"
#include "slivers/flat_cells.hpp"

namespace fastsim {

namespace {

constexpr std::size_t most_flips = 100;
constexpr int most_passes = 2;

/// Tries each item, those that are stuck again once others are there; leaves what is stuck.
template <typename Item, typename Try>
void try_each(std::vector<Item> &items, Watch &watch, const Try &attempt) {
    for (int pass = 0; pass < most_passes && !items.empty(); ++pass)
        std::erase_if(items, [&](const Item &item) {
            watch.look();
            return attempt(item);
        });
}

/// The surface of all parts. A part that two facets share, once each way, lies between points of
/// one edge: both go, and with them a point.
RefinedSurface refine(std::span<const Triple> facets, const SteinerRecovery &steiner) {
    std::unordered_map<Triple, int, TripleHash> uses;
    for (const Triple &f : facets)
        for (const Triple &part : steiner.parts(f))
            ++uses[sorted_triple(part[0], part[1], part[2])];
    RefinedSurface refined;
    for (std::size_t i = 0; i < facets.size(); ++i)
        for (const Triple &part : steiner.parts(facets[i]))
            if (uses[sorted_triple(part[0], part[1], part[2])] == 1)
                refined.add(part, static_cast<Index>(i));
    return refined;
}

} // namespace

RecoveryReport recover_boundary(TetComplex &complex, std::span<const Triple> facets,
                                Index first_inner, Protection &protection, Watch &watch) {
    using Edge = std::array<Index, 2>;
    RecoveryReport report;
    FlipRecovery flips(complex, protection);
    // The limit bounds the work: many times what any surface tried so far has needed.
    SteinerRecovery steiner(complex, protection, first_inner, 500 + 4 * facets.size(), watch);

    std::vector<Edge> edges;
    std::unordered_set<std::uint64_t> seen;
    for (const Triple &f : facets)
        for (std::size_t k = 0; k < 3; ++k) {
            const Edge e{f[k], f[(k + 1) % 3]};
            if (!seen.insert(edge_key(e[0], e[1])).second)
                continue;
            if (complex.has_edge(e[0], e[1]))
                protection.edges.insert(edge_key(e[0], e[1]));
            else
                edges.push_back(e);
        }
    watch.begin("bringing edges of the surface in", edges.size());
    report.recovered_edges = edges.size();
    const auto flip_in = [&](const Edge &e) {
        const bool is_there = flips.recover_edge(e[0], e[1], most_flips);
        if (is_there)
            protection.edges.insert(edge_key(e[0], e[1]));
        return is_there;
    };
    try_each(edges, watch, flip_in);
    if (!edges.empty()) {
        // Points in one plane but for roundings make cells that flips cannot see through.
        remove_flat_cells(complex, protection, true);
        try_each(edges, watch, flip_in);
    }
    report.recovered_edges -= edges.size();
    try_each(edges, watch, [&](const Edge &e) { return steiner.recover_edge(e[0], e[1]); });
    report.missing_edges = edges;

    std::vector<Index> lost;
    const auto protect_if_there = [&](const Triple &f) {
        // Beside a cut edge the whole one may be there too.
        const bool is_there =
            !steiner.is_cut(f) && complex.find_facet(f[0], f[1], f[2]).cell != none;
        if (is_there)
            protection.facets.insert(sorted_triple(f[0], f[1], f[2]));
        return is_there;
    };
    for (std::size_t i = 0; i < facets.size(); ++i)
        if (!protect_if_there(facets[i]))
            lost.push_back(static_cast<Index>(i));
    watch.begin("bringing facets of the surface in", lost.size());
    report.recovered_facets = lost.size();
    const auto facet = [&](Index i) -> const Triple & { return facets[TetComplex::at(i)]; };
    try_each(lost, watch, [&](Index i) {
        return !steiner.is_cut(facet(i)) && flips.recover_facet(facet(i), most_flips) &&
               protect_if_there(facet(i));
    });
    report.recovered_facets -= lost.size();
    if (report.missing_edges.empty())
        std::erase_if(lost, [&](Index i) { return steiner.recover_facet(facet(i)); });
    report.missing_facets = lost;

    if (steiner.has_cut() && lost.empty()) {
        report.steiner_points = steiner.points();
        report.refined = refine(facets, steiner);
    }
    return report;
}

} // namespace fastsim
