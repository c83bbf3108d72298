#include "collision/edges_near_edges.hpp"

#include "collision/narrow_phase.hpp"

#include <bit>

namespace fastsim {

namespace {

using Index = std::int32_t;
using Edge = std::array<Index, 2>;

// Tried on bodies of 15 000 to 150 000 edges, from 16 to 64, and from 0.25 to 1 block.
constexpr std::size_t edges_in_block = 32;
constexpr double voxel_per_block = 0.5;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool have_common_point(const Edge &a, const Edge &b) {
    return a[0] == b[0] || a[0] == b[1] || a[1] == b[0] || a[1] == b[1];
}

} // namespace

EdgesNearEdges::EdgesNearEdges(std::span<const Position> first_points, std::span<const Edge> first,
                               std::span<const Position> second_points,
                               std::span<const Edge> second, bool is_same_body)
    : _given(first.begin(), first.end()), _second(second_points, second, edges_in_block),
      _hash(first.size()), _bits(first.size()), _order(second.size()), _is_same_body(is_same_body) {
    std::vector<double> sizes;
    std::vector<Position> middles;
    for (const Edge &edge : first) {
        const Extent box = extent_of(first_points, edge);
        sizes.push_back(box.longest());
        middles.push_back(box.middle());
    }
    const SizeClasses classes = sort_by_size(sizes);
    // In the order of the blocks, too, when the edges are the same.
    _first_number = compact_order(middles, classes, edges_in_block);
    for (const Index e : _first_number) {
        _first.push_back(first[at(e)]);
        _class.push_back(classes.of[at(e)]);
    }
    for (std::size_t k = 0; k < classes.count(); ++k) {
        SizeClass &one = _classes.emplace_back();
        one.size = classes.mean[k];
        one.active.reserve(static_cast<std::size_t>(
            std::count(_class.begin(), _class.end(), static_cast<std::uint8_t>(k))));
    }
    _hashed.reserve(first.size());
    _candidates.reserve(4 * second.size() + 64); // grows, once, where more are found
    _found.reserve(second.size() + 64);
}

void EdgesNearEdges::take_active(std::span<const Position> first_points, const Extent &near) {
    for (SizeClass &one : _classes) {
        one.active.clear();
        one.middles = Extent::nothing();
        one.half = {};
    }
    for (std::size_t e = 0; e < _first.size(); ++e) {
        const Extent box = extent_of(first_points, _first[e]);
        if (!box.meets(near))
            continue;
        SizeClass &one = _classes[_class[e]];
        one.active.push_back(static_cast<Index>(e));
        one.middles.add(box.middle());
        for (std::size_t i = 0; i < 3; ++i)
            one.half[i] = std::max(one.half[i], 0.5 * (box.high[i] - box.low[i]));
    }
}

std::span<const EdgesNearEdges::Pair>
EdgesNearEdges::find_candidates(std::span<const Position> first_points,
                                std::span<const Position> second_points, double distance) {
    _candidates.clear();
    const Extent all_first = extent_of_all(first_points);
    const Extent all_second = extent_of_all(second_points);
    const double reach = reach_of(distance, all_second);
    if (!all_second.grown(reach).meets(all_first))
        return _candidates;
    take_active(first_points, all_second.grown(reach));
    // A box's middle is off by a rounding or two of its coordinates, which the reach of no
    // distance at all is more than.
    const double slack = reach_of(0.0, all_first);
    for (SizeClass &one : _classes) {
        for (double &half : one.half)
            half += slack;
        if (!one.active.empty())
            look_up(one, first_points, second_points, reach);
    }
    _order.sort(
        _candidates, [](const Pair &pair) { return pair[1]; },
        [](const Pair &pair) { return pair[0]; });
    return _candidates;
}

void EdgesNearEdges::look_up(const SizeClass &one, std::span<const Position> first_points,
                             std::span<const Position> second_points, double reach) {
    const auto middle_of = [&](Index e) { return extent_of(first_points, _first[at(e)]).middle(); };
    std::size_t filled = _second.mean_size().size(); // class that the hash is for now
    for (const auto &block : _second.blocks()) {
        const Extent box = _second.extent(block, second_points).grown(reach);
        Extent around = box;
        for (std::size_t i = 0; i < 3; ++i) {
            around.low[i] -= one.half[i];
            around.high[i] += one.half[i];
        }
        if (!around.meets(one.middles))
            continue;
        if (filled != block.size_class) {
            filled = block.size_class; // blocks of a class follow one another
            _hash.fill(one.active, one.middles,
                       std::max(voxel_per_block * _second.mean_size()[filled], one.size) + reach,
                       middle_of);
            _hashed.clear();
            for (const VoxelHash::Entry &entry : _hash.entries())
                _hashed.push_back(extent_of(first_points, _first[at(entry.id)]));
        }
        std::span<std::uint32_t> places = _hash.near(around);
        if (_is_same_body) {
            // Both lists are in the same order: of two edges the earlier one is looked up.
            const auto is_later = [&](std::uint32_t k) {
                return at(_hash.entries()[k].id) >= block.last;
            };
            places = {places.begin(), std::remove_if(places.begin(), places.end(), is_later)};
        }
        if (places.empty())
            continue;
        _second.fit(block, second_points, reach, _boxes);
        _boxes.find_meeting({_hashed[0].low.data(), _hashed[0].high.data(), 6}, places,
                            _bits.data());
        if (_is_same_body)
            _second.mark(block);
        for (std::size_t j = 0; j < places.size(); ++j) {
            const auto first = at(_hash.entries()[places[j]].id);
            std::uint64_t bits = _bits[j];
            if (_is_same_body) {
                if (first >= block.first)
                    bits &= ~std::uint64_t{1} << (first - block.first);
                bits &= ~(_second.with_corner(block, _first[first][0]) |
                          _second.with_corner(block, _first[first][1]));
            }
            for (; bits != 0; bits &= bits - 1) {
                const auto bit = static_cast<std::size_t>(std::countr_zero(bits));
                const Index a = _first_number[first], b = _second.number(block.first + bit);
                _candidates.push_back(_is_same_body && b < a ? Pair{b, a} : Pair{a, b});
            }
        }
    }
}

std::span<const EdgeNearEdge> EdgesNearEdges::find(std::span<const Position> first_points,
                                                   std::span<const Position> second_points,
                                                   double distance) {
    _found.clear();
    for (const auto &[first, second] : find_candidates(first_points, second_points, distance)) {
        EdgeNearEdge pair{first, second, {}, 0.0};
        if (is_near(first_points, _given[at(first)], second_points, _second.elements()[at(second)],
                    distance, pair))
            _found.push_back(pair);
    }
    return _found;
}

bool is_near(std::span<const Position> first_points, const Edge &first,
             std::span<const Position> second_points, const Edge &second, double distance,
             EdgeNearEdge &pair) {
    const NearestOnEdges nearest =
        nearest_on_edges(first_points[at(first[0])], first_points[at(first[1])],
                         second_points[at(second[0])], second_points[at(second[1])]);
    pair.parameters = nearest.parameters;
    pair.distance_squared = nearest.distance_squared;
    return nearest.distance_squared <= distance * distance;
}

std::vector<EdgeNearEdge> find_edges_near_edges_brute_force(std::span<const Position> first_points,
                                                            std::span<const Edge> first,
                                                            std::span<const Position> second_points,
                                                            std::span<const Edge> second,
                                                            double distance, bool is_same_body,
                                                            bool only_candidates) {
    std::vector<EdgeNearEdge> found;
    static_cast<void>(extent_of_all(first_points)); // refused if not finite
    const double reach = reach_of(distance, extent_of_all(second_points));
    for (std::size_t e = 0; e < second.size(); ++e) {
        const Extent box = extent_of(second_points, second[e]).grown(reach);
        for (std::size_t f = 0; f < (is_same_body ? e : first.size()); ++f) {
            if (is_same_body && have_common_point(first[f], second[e]))
                continue;
            EdgeNearEdge pair{static_cast<Index>(f), static_cast<Index>(e), {}, 0.0};
            const bool is_candidate = box.meets(extent_of(first_points, first[f]));
            const bool is_within =
                is_near(first_points, first[f], second_points, second[e], distance, pair);
            if (only_candidates ? is_candidate : is_within)
                found.push_back(pair);
        }
    }
    return found;
}

} // namespace fastsim
