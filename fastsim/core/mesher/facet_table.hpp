#pragma once
// Given facets, found by their corners in any order.

#include "mesher/tet_complex.hpp"

#include <span>
#include <vector>

namespace fastsim {

class FacetTable {
  public:
    explicit FacetTable(std::span<const Triple> facets);

    /// Number of the facet with these corners, the first of equal ones, or none.
    Index find(const Triple &facet) const {
        const auto count = static_cast<Index>(_first.size()) - 1;
        // Most facets that are asked about have a corner inside.
        if (facet[0] >= count || facet[1] >= count || facet[2] >= count)
            return none;
        return search(sorted_triple(facet[0], facet[1], facet[2]));
    }

    /// Whether one of a cell's facets can be among them: of most cells inside two corners are too
    /// high.
    bool may_have_one_of(const Cell &cell) const {
        const auto count = static_cast<Index>(_first.size()) - 1;
        return (cell[0] < count) + (cell[1] < count) + (cell[2] < count) + (cell[3] < count) > 2;
    }

  private:
    Index search(const Triple &t) const;

    struct Entry {
        Index middle, largest, facet;
    };

    std::vector<std::size_t> _first; // by smallest corner, of which few facets share one
    std::vector<Entry> _entries;     // sorted for each
};

} // namespace fastsim
