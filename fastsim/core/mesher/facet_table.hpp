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
    Index find(const Triple &facet) const;

  private:
    struct Entry {
        Index middle, largest, facet;
    };

    std::vector<std::size_t> _first; // by smallest corner, of which few facets share one
    std::vector<Entry> _entries;     // sorted for each
};

} // namespace fastsim
