#pragma once
// Second half of boundary recovery: points on the edges and facets that flips do not bring back.
//
// An edge is cut where it meets the cells in its way. A facet whose edges are there is followed
// through the complex from its rim inwards, triangle by triangle; where an edge of the complex
// pierces it, that edge is cut. Either has no more cuts than crossings, so both end.

#include "mesher/watch.hpp"
#include "recovery/flip_recovery.hpp"
#include "recovery/refined_surface.hpp"

#include <unordered_map>
#include <unordered_set>

namespace fastsim {

class SteinerRecovery {
  public:
    SteinerRecovery(TetComplex &complex, Protection &protection, Index first_inner,
                    std::size_t most_points, Watch &watch);

    /// Brings in edge (a, b), cut into parts where needed. False when it stays missing.
    bool recover_edge(Index a, Index b);
    /// Brings in a facet whose edges, or their parts, are there.
    bool recover_facet(const Triple &f);

    /// Whether any edge or facet was cut.
    bool has_cut() const { return !_points.empty(); }
    /// Points on the surface, in order.
    const std::vector<Index> &points() const { return _points; }
    /// The parts of facet f after its recovery.
    std::vector<Triple> parts(const Triple &f) const;
    bool is_cut(const Triple &f) const;

  private:
    using Edge = std::array<Index, 2>;
    struct Candidate {
        double from_middle; // the smaller the better
        Point place;
        std::vector<Index> cells; // where to insert
    };
    struct Front {
        Triple facet;
        std::vector<Edge> open;                   // what is left of the facet lies on their left
        std::unordered_set<Index> on;             // points on the facet
        std::unordered_set<std::uint64_t> passed; // directed edges of its parts so far
        std::vector<Triple> parts;
    };

    const Point &place(Index i) const { return _complex.points[TetComplex::at(i)]; }
    Index cut_edge(Index a, Index b);
    std::vector<Candidate> crossings(Index a, Index b, Index &point_on_it) const;
    Index next_point(Front &front, Index a, Index b);
    Index point_in_ring(Front &front, Index a, Index b, const std::vector<Index> &ring);
    Index corner_of_front(const Front &front, Index a, Index b) const;
    Point normal_of(const Triple &f) const;
    bool lies_on(const Triple &f, Index w) const;
    bool ring_of(Index a, Index b, std::vector<Index> &ring) const;
    Index cut_piercing(const Front &front, Index u, Index v);
    Index insert(std::vector<Candidate> &candidates);
    std::vector<Index> chain(Index a, Index b) const;

    TetComplex &_complex;
    Protection &_protection;
    Watch &_watch;
    FlipRecovery _flips;
    Index _first_inner;
    std::size_t _most_points;
    std::size_t _num_inserted = 0;
    std::vector<Index> _points;
    std::unordered_map<std::uint64_t, std::vector<Index>> _chains; // by edge, from its lower end
    std::unordered_map<Triple, std::vector<Triple>, TripleHash> _parts; // by sorted facet
};

} // namespace fastsim
