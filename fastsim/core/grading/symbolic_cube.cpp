#include "grading/symbolic_cube.hpp"

#include <algorithm>

namespace fastsim {

SymbolicCube::SymbolicCube() {
    std::array<std::int8_t, 3> axis{1, 2, 3};
    do {
        _codes.insert(CellName{0, {0, 0, 0}, axis}.canonical().code());
    } while (std::next_permutation(axis.begin(), axis.end()));
}

bool SymbolicCube::refine(std::span<const std::uint8_t> marked) {
    const std::vector<CellName> before = cells();
    for (std::size_t k = 0; k < before.size(); ++k)
        // A marked cell may have been bisected for another's sake.
        if (marked[k] && _codes.count(before[k].code()) && !bisect(before[k]))
            return false;
    return true;
}

bool SymbolicCube::bisect(const CellName &cell) {
    // The cube's centre must still have whole coordinates a generation on. A cell that is not
    // there would mean a mesh that does not conform.
    if (cell.generation + 1 > 3 * (CellName::finest - 2) || !_codes.count(cell.code()))
        return false;
    // All cells at the refinement edge, found by going round it from facet to facet. One that is
    // a generation behind is bisected first (Maubach 1995, his recursion; it ends, for a
    // generation behind means a refinement edge that is longer).
    std::vector<CellName> around{cell}, todo{cell};
    while (!todo.empty()) {
        const CellName here = todo.back();
        todo.pop_back();
        for (int k = 0; k < 4; ++k) {
            // Facets that hold the refinement edge: opposite the two corners that are not its ends.
            const int far_end = 3 - here.generation % 3;
            if (k == 0 || k == far_end)
                continue;
            const CellName next = here.neighbour(k);
            if (!next.is_inside() || std::find(around.begin(), around.end(), next) != around.end())
                continue;
            if (!_codes.count(next.code()) && !bisect(next.parent()))
                return false;
            around.push_back(next);
            todo.push_back(next);
        }
    }
    for (const CellName &one : around) {
        _codes.erase(one.code());
        for (const CellName &child : one.children())
            _codes.insert(child.code());
    }
    return true;
}

std::vector<CellName> SymbolicCube::cells() const {
    std::vector<std::uint64_t> codes(_codes.begin(), _codes.end());
    std::sort(codes.begin(), codes.end());
    std::vector<CellName> out;
    out.reserve(codes.size());
    for (const std::uint64_t code : codes)
        out.push_back(cell_of_code(code));
    return out;
}

} // namespace fastsim
