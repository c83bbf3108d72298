// The calculus of names; see symbolic_cube.hpp.
#include "grading/symbolic_cube.hpp"

#include <cstdlib>

namespace fastsim {

namespace {

std::int8_t minus(std::int8_t axis) { return static_cast<std::int8_t>(-axis); }

} // namespace

CellName::Place CellName::step(const Place &from, int axis_number, std::int32_t length) const {
    const std::int8_t a = axis[static_cast<std::size_t>(axis_number)];
    Place to = from;
    to[static_cast<std::size_t>(std::abs(a) - 1)] += a > 0 ? length : -length;
    return to;
}

std::array<CellName::Place, 4> CellName::corners() const {
    const std::int32_t h = side(), half = h / 2;
    const Place &x = corner;
    const Place xa = step(x, 0, h), xab = step(xa, 1, h);
    const Place face = step(step(x, 0, half), 1, half), centre = step(face, 2, half);
    switch (generation % 3) {
    case 0:
        return {x, xa, xab, step(xab, 2, h)};
    case 1:
        return {x, xa, xab, centre};
    default:
        return {x, xa, face, centre};
    }
}

CellName CellName::from_other_end() const {
    const auto [a, b, c] = axis;
    const std::array<Place, 4> x = corners();
    switch (generation % 3) {
    case 0:
        return {generation, x[3], {minus(c), minus(b), minus(a)}};
    case 1:
        return {generation, x[2], {minus(b), minus(a), c}};
    default:
        return {generation, x[1], {minus(a), b, c}};
    }
}

CellName CellName::canonical() const {
    // Parity of each coordinate in units of the side. Cubes' diagonals run from an all-even corner
    // to an all-odd one (a cube's centre is the odd corner of its eight parts), and faces'
    // diagonals from a corner that is even or odd in the plane as the face is across it, to one
    // that is not. So the ends of a refinement edge can always be told apart.
    const auto is_odd = [&](int axis_number) {
        const int i = std::abs(axis[static_cast<std::size_t>(axis_number)]) - 1;
        return (corner[static_cast<std::size_t>(i)] / side()) % 2 != 0;
    };
    bool is_first = false;
    switch (generation % 3) {
    case 0:
        is_first = !is_odd(0); // the even end of the diagonal
        break;
    case 1:
        is_first = is_odd(0) == is_odd(2); // the end of the face's diagonal that is on the cube's
        break;
    default:
        is_first = is_odd(0) == is_odd(1); // the end of the side that is on the face's diagonal
        break;
    }
    return is_first ? *this : from_other_end();
}

std::array<CellName, 2> CellName::children() const {
    // The name from either end is, one generation on, the child at that end.
    CellName one = *this, two = from_other_end();
    ++one.generation;
    ++two.generation;
    return {one.canonical(), two.canonical()};
}

CellName CellName::parent() const {
    // A canonical name starts at the end that the parent's refinement edge had, too.
    CellName up = *this;
    --up.generation;
    return up.canonical();
}

CellName CellName::neighbour(int k) const {
    // Across cubes' and faces' planes the mesh is its own mirror image.
    const auto [a, b, c] = axis;
    const std::array<Place, 4> x = corners();
    const auto named = [&](const Place &at, std::int8_t p, std::int8_t q, std::int8_t r) {
        return CellName{generation, at, {p, q, r}}.canonical();
    };
    switch (k) {
    case 1:
        return named(x[0], b, a, c);
    case 2:
        return named(x[0], a, c, b);
    case 3:
        return named(x[0], a, b, minus(c));
    default:
        break;
    }
    switch (generation % 3) {
    case 0:
        return named(step(x[1], 0, side()), minus(a), b, c);
    case 1: // the sibling across the cube, from its far corner
        return named(step(x[2], 2, side()), minus(c), minus(b), minus(a));
    default:
        return named(step(x[1], 1, side()), minus(b), minus(a), c);
    }
}

bool CellName::is_inside() const {
    // The middle of the cell, four times.
    std::array<std::int64_t, 3> sum{};
    for (const Place &p : corners())
        for (std::size_t i = 0; i < 3; ++i)
            sum[i] += p[i];
    for (const std::int64_t s : sum)
        if (s < 0 || s > std::int64_t{4} << finest)
            return false;
    return true;
}

std::uint64_t CellName::code() const {
    std::uint64_t order = 0, signs = 0;
    // Six orders of the axes: 2 * first + (second > third).
    order = static_cast<std::uint64_t>(2 * (std::abs(axis[0]) - 1)) +
            (std::abs(axis[1]) > std::abs(axis[2]) ? 1u : 0u);
    for (std::size_t i = 0; i < 3; ++i)
        signs |= (axis[i] < 0 ? std::uint64_t{1} : 0u) << i;
    std::uint64_t code = static_cast<std::uint64_t>(generation) << 57 | order << 54 | signs << 51;
    for (std::size_t i = 0; i < 3; ++i)
        code |= static_cast<std::uint64_t>(corner[i]) << (17 * i);
    return code;
}

CellName cell_of_code(std::uint64_t code) {
    CellName cell;
    cell.generation = static_cast<std::int32_t>(code >> 57);
    const auto order = static_cast<int>((code >> 54) & 7), first = order / 2;
    const int low = first == 0 ? 1 : 0, high = first == 2 ? 1 : 2;
    const std::array<int, 3> axes{first, order % 2 ? high : low, order % 2 ? low : high};
    for (std::size_t i = 0; i < 3; ++i) {
        cell.axis[i] =
            static_cast<std::int8_t>((code >> (51 + i)) & 1 ? -(axes[i] + 1) : axes[i] + 1);
        cell.corner[i] = static_cast<std::int32_t>((code >> (17 * i)) & 0x1FFFF);
    }
    return cell;
}

} // namespace fastsim
