#include "collision/edges_near_edges.hpp"

#include "collision/narrow_phase.hpp"

namespace fastsim {

namespace {

using Index = std::int32_t;
using Edge = std::array<Index, 2>;

// Tried on bodies of 8 000 to 80 000 edges, from 16 to 64, and from 0.25 to 1 block.
constexpr std::size_t edges_in_block = 32;
constexpr double voxel_per_block = 0.5;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

bool have_common_point(const Edge &a, const Edge &b) {
    return a[0] == b[0] || a[0] == b[1] || a[1] == b[0] || a[1] == b[1];
}

} // namespace

EdgesNearEdges::EdgesNearEdges(std::span<const Position> first_points, std::span<const Edge> first,
                               std::span<const Position> second_points,
                               std::span<const Edge> second, bool is_same_body,
                               std::size_t num_threads, InstructionSet at_most)
    : _given(first.begin(), first.end()), _second(second_points, second, edges_in_block),
      _hash(first.size()), _searches(num_threads, Search(_second, first.size(), at_most)),
      _workers(num_threads), _order(second.size()), _is_same_body(is_same_body) {
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
        for (std::size_t k = 0; k < _second.num_classes() && !one.active.empty(); ++k) {
            hash(one, first_points,
                 std::max(voxel_per_block * _second.mean_size()[k], one.size) + reach);
            const auto blocks = _second.blocks(k);
            _workers.hand_out(blocks.size(), [&](std::size_t worker, std::size_t b) {
                look_into(blocks[b], one, second_points, reach, _searches[worker]);
            });
        }
    }
    for (Search &search : _searches) {
        _candidates.insert(_candidates.end(), search.found.begin(), search.found.end());
        search.found.clear();
    }
    _order.sort(
        _candidates, [](const Pair &pair) { return pair[1]; },
        [](const Pair &pair) { return pair[0]; });
    return _candidates;
}

void EdgesNearEdges::hash(const SizeClass &one, std::span<const Position> first_points,
                          double voxel_size) {
    const auto box_of = [&](Index e) { return extent_of(first_points, _first[at(e)]); };
    _hash.fill(one.active, one.middles, voxel_size, [&](Index e) { return box_of(e).middle(); });
    _hashed.clear();
    for (const VoxelHash::Entry &entry : _hash.entries())
        _hashed.push_back(box_of(entry.id));
}

void EdgesNearEdges::look_into(const Blocks::Block &block, const SizeClass &one,
                               std::span<const Position> second_points, double reach,
                               Search &search) const {
    Extent around = _second.extent(block, second_points).grown(reach);
    for (std::size_t i = 0; i < 3; ++i) {
        around.low[i] -= one.half[i];
        around.high[i] += one.half[i];
    }
    if (!around.meets(one.middles))
        return;
    const auto place_of = [&](std::uint32_t k) { return at(_hash.entries()[k].id); };
    // Within one body both lists are in the same order: the earlier of two edges is looked up.
    const auto places = search.look_up(
        _hash, around, [&](std::uint32_t k) { return !_is_same_body || place_of(k) < block.last; });
    if (places.empty())
        return;
    if (_is_same_body)
        search.mark(_second, block);
    const auto left_out = [&](std::uint32_t k) -> std::uint64_t {
        if (!_is_same_body)
            return 0;
        const std::size_t first = place_of(k);
        const std::uint64_t not_later =
            first >= block.first ? ~(~std::uint64_t{1} << (first - block.first)) : 0;
        return not_later | search.with_corner(_second, block, _first[first][0]) |
               search.with_corner(_second, block, _first[first][1]);
    };
    search.test(_second, block, second_points, reach,
                {_hashed[0].low.data(), _hashed[0].high.data(), sizeof(Extent) / sizeof(double)},
                places, left_out, [&](std::uint32_t k, Index b) {
                    const Index a = _first_number[place_of(k)];
                    search.found.push_back(_is_same_body && b < a ? Pair{b, a} : Pair{a, b});
                });
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
