#include "slivers/flat_cells.hpp"

#include "recovery/steiner_insertion.hpp"

#include <algorithm>

namespace fastsim {

namespace {

// Smallest sine of a dihedral angle: well above the roundings of a cell's volume.
constexpr double flat = 1e-9;
constexpr std::size_t largest_ring = 12;
constexpr int most_passes = 4;

class FlatCells {
  public:
    FlatCells(TetComplex &complex, const Protection &protection, bool may_insert)
        : _complex(complex), _protection(protection), _may_insert(may_insert) {}

    bool is_flat(Index c) const {
        return _complex.is_alive(c) && cell_quality(_complex, _complex.cell(c)) < flat;
    }

    bool remove(Index c) { return flip(c) || (_may_insert && insert_beside(c)); }

  private:
    bool flip(Index c) {
        const Cell v = _complex.cell(c);
        for (std::size_t i = 0; i < 4; ++i)
            for (std::size_t j = i + 1; j < 4; ++j)
                if (remove_edge(_complex, v[i], v[j], _protection, largest_ring, flat, none, none))
                    return true;
        for (int k = 0; k < 4; ++k)
            if (flip_facet(_complex, {c, k}, _protection, flat))
                return true;
        return false;
    }

    /// A point in a neighbour, or in one of its neighbours, that sees the cell's far side.
    bool insert_beside(Index c) {
        std::vector<Index> near{c};
        for (std::size_t i = 0; i < near.size() && near.size() < 20; ++i)
            for (int k = 0; k < 4; ++k) {
                const Index n = _complex.neighbour(near[i], k);
                if (n != none && std::find(near.begin(), near.end(), n) == near.end())
                    near.push_back(n);
            }
        const auto s = static_cast<Index>(_complex.points.size());
        _complex.add_point({});
        for (const Index n : near) {
            if (is_flat(n))
                continue;
            Point centre{};
            for (const Index v : _complex.cell(n))
                for (std::size_t i = 0; i < 3; ++i)
                    centre[i] += 0.25 * _complex.points[TetComplex::at(v)][i];
            _complex.points.back() = centre;
            if (insert_star(_complex, _protection, {n, c}, s, flat))
                return true;
        }
        return false; // the point stays, in no cell
    }

    TetComplex &_complex;
    const Protection &_protection;
    bool _may_insert;
};

Index first_flat_cell(const TetComplex &complex, std::span<const double> sines) {
    for (std::size_t slot = 0; slot < sines.size(); ++slot)
        if (sines[slot] < flat && complex.is_alive(static_cast<Index>(slot)))
            return static_cast<Index>(slot);
    return none;
}

} // namespace

bool has_flat_cell(const TetComplex &complex, std::span<const double> sines) {
    return first_flat_cell(complex, sines) != none;
}

std::size_t remove_flat_cells(TetComplex &complex, const Protection &protection, bool may_insert) {
    const Index first_flat = first_flat_cell(complex, rate_all_cells(complex, 0.0).sines);
    if (first_flat == none)
        return 0;
    FlatCells cells(complex, protection, may_insert);
    std::size_t left = 0;
    for (int pass = 0; pass < most_passes; ++pass) {
        left = 0;
        std::size_t removed = 0;
        const auto count = static_cast<Index>(complex.num_slots());
        for (Index c = pass == 0 ? first_flat : 0; c < count; ++c)
            if (cells.is_flat(c))
                ++(cells.remove(c) ? removed : left);
        if (removed == 0)
            break;
    }
    return left;
}

} // namespace fastsim
