#include "recovery/boundary_recovery.hpp"

#include "mesher/facet_table.hpp"
#include "recovery/flip_recovery.hpp"
#include "recovery/plane_recovery.hpp"
#include "recovery/steiner_recovery.hpp"
#include "slivers/flat_cells.hpp"

#include <unordered_set>

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
            const bool is_done = attempt(item);
            if (is_done)
                watch.count();
            return is_done;
        });
}

/// Finds which of the facets are there, by the cells that are not those of the last look.
void look(const TetComplex &complex, const FacetTable &table, std::span<const Cell> last,
          std::vector<char> &is_there) {
    const auto is_new = [&](Index c) {
        return TetComplex::at(c) >= last.size() || last[TetComplex::at(c)] != complex.cell(c);
    };
    const auto mark = [&](const Cell &cell, int k, char value) {
        const Index found = table.find(TetComplex::facet_of(cell, k));
        if (found != none)
            is_there[TetComplex::at(found)] = value;
    };
    for (std::size_t slot = 0; slot < last.size(); ++slot)
        for (int k = 0; k < 4 && last[slot][0] != none && is_new(static_cast<Index>(slot)); ++k)
            mark(last[slot], k, 0);
    for (std::size_t slot = 0; slot < complex.num_slots(); ++slot) {
        const auto c = static_cast<Index>(slot);
        if (!complex.is_alive(c) || !table.may_have_one_of(complex.cell(c)) || !is_new(c))
            continue;
        for (int k = 0; k < 4; ++k) {
            const Index beyond = complex.neighbour(c, k);
            if (beyond <= c || !is_new(beyond)) // else it is seen from there
                mark(complex.cell(c), k, 1);
        }
    }
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

    recover_planes(complex, facets, protection, watch);
    const FacetTable table(facets);
    std::vector<char> is_there(facets.size(), 0);
    look(complex, table, {}, is_there);
    std::vector<Edge> edges;
    std::unordered_set<std::uint64_t> missing;
    protection.edges.reserve(3 * facets.size() / 2);
    for (std::size_t i = 0; i < facets.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k) {
            const Edge e{facets[i][k], facets[i][(k + 1) % 3]};
            const std::uint64_t key = edge_key(e[0], e[1]);
            // With a facet its edges are there; others may be there without it.
            if (is_there[i])
                protection.edges.insert(key);
            else if (protection.edges.contains(key) || missing.contains(key))
                continue;
            else if (complex.has_edge(e[0], e[1]))
                protection.edges.insert(key);
            else {
                missing.insert(key);
                edges.push_back(e);
            }
        }
    watch.begin("bringing edges of the surface in", edges.size());
    report.recovered_edges = edges.size();
    std::vector<Cell> before_flips;
    if (!edges.empty())
        before_flips.assign(complex.cells().begin(), complex.cells().end());
    const auto flip_in = [&](const Edge &e) {
        const bool is_flipped_in = flips.recover_edge(e[0], e[1], most_flips);
        if (is_flipped_in)
            protection.edges.insert(edge_key(e[0], e[1]));
        return is_flipped_in;
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
    const auto protect = [&](const Triple &f) {
        protection.facets.insert(sorted_triple(f[0], f[1], f[2]));
    };
    if (!before_flips.empty())
        look(complex, table, before_flips, is_there);
    protection.facets.reserve(facets.size());
    for (std::size_t i = 0; i < facets.size(); ++i)
        // Beside a cut edge the whole one may be there too.
        if (is_there[i] && !steiner.is_cut(facets[i]))
            protect(facets[i]);
        else
            lost.push_back(static_cast<Index>(i));
    watch.begin("bringing facets of the surface in", lost.size());
    report.recovered_facets = lost.size();
    const auto facet = [&](Index i) -> const Triple & { return facets[TetComplex::at(i)]; };
    try_each(lost, watch, [&](Index i) {
        const bool is_flipped_in =
            !steiner.is_cut(facet(i)) && flips.recover_facet(facet(i), most_flips);
        if (is_flipped_in)
            protect(facet(i));
        return is_flipped_in;
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
