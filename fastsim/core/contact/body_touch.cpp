#include "contact/body_touch.hpp"

#include "predicates/vector_algebra.hpp"

#include <algorithm>
#include <utility>

namespace fastsim {

BodyTouch::BodyTouch(std::span<const Position> rest, std::span<const Cell> cells,
                     std::span<const std::int32_t> vertices, std::span<const Facet> facets,
                     std::span<const std::int32_t> parts, std::span<const double> stiffnesses,
                     InstructionSet at_most)
    : _cells(cells.begin(), cells.end()), _detection(rest, cells, vertices, true, 1, at_most),
      _rest(rest.begin(), rest.end()), _part_of(parts.begin(), parts.end()),
      _stiffness_of(rest.size(), 0.0) {
    for (std::size_t k = 0; k < vertices.size(); ++k)
        _stiffness_of[static_cast<std::size_t>(vertices[k])] = stiffnesses[k];
    std::vector<std::vector<Facet>> own;
    for (const Facet &facet : facets) {
        const auto part = static_cast<std::size_t>(_part_of[static_cast<std::size_t>(facet[0])]);
        if (part >= own.size())
            own.resize(part + 1);
        own[part].push_back(facet);
    }
    for (std::vector<Facet> &part : own)
        _surfaces.emplace_back(_rest, std::move(part));
}

std::span<const PointForce> BodyTouch::find_forces(std::span<const Position> points) {
    _forces.clear();
    _num_touching = 0;
    _deepest = 0.0;
    std::int32_t last = -1;
    for (const VertexInCell &found : _detection.find(points, points)) {
        // On the side between two cells a vertex is in both: pushed once.
        if (found.vertex == last)
            continue;
        last = found.vertex;
        const Cell &cell = _cells[static_cast<std::size_t>(found.cell)];
        const auto corner = [&](std::size_t a) { return static_cast<std::size_t>(cell[a]); };
        Point place{};
        for (std::size_t a = 0; a < 4; ++a)
            place = along(place, _rest[corner(a)], found.weights[a]);
        const auto part = static_cast<std::size_t>(_part_of[corner(0)]);
        const Point inward = minus(place, _surfaces[part].closest(place).point);
        const double depth = norm(inward);
        ++_num_touching;
        if (!(depth > 0.0))
            continue;
        _deepest = std::max(_deepest, depth);
        std::array<Point, 3> edge{};
        for (std::size_t a = 0; a < 3; ++a)
            edge[a] = minus(points[corner(a + 1)], points[corner(0)]);
        const std::array<Point, 3> across{cross(edge[1], edge[2]), cross(edge[2], edge[0]),
                                          cross(edge[0], edge[1])};
        const double volume = dot(edge[0], across[0]);
        Point gradient{};
        for (std::size_t a = 0; a < 3; ++a)
            gradient = along(gradient, across[a],
                             dot(inward, minus(_rest[corner(a + 1)], _rest[corner(0)])) /
                                 (depth * volume));
        const double push = _stiffness_of[static_cast<std::size_t>(found.vertex)] * depth;
        const Point force = along({}, gradient, -push);
        _forces.push_back({found.vertex, force});
        for (std::size_t a = 0; a < 4; ++a)
            _forces.push_back({cell[a], along({}, force, -found.weights[a])});
    }
    return _forces;
}

} // namespace fastsim
