// Undoing bisections: the other half of BisectedMesh.
#include "grading/bisected_mesh.hpp"

namespace fastsim {

std::size_t BisectedMesh::coarsen(std::span<const std::uint8_t> marked) {
    const std::vector<Index> leaf = leaf_numbers();
    // A point goes when it is the newest corner of every cell around it, and all want it gone.
    std::vector<std::uint8_t> goes(_points.size());
    for (std::size_t v = 0; v < _points.size(); ++v)
        goes[v] = _parents[v][0] >= 0;
    for (std::size_t k = 0; k < leaf.size(); ++k) {
        const Node &node = _nodes[at(leaf[k])];
        for (std::size_t i = 0; i < 4; ++i)
            if (node.parent < 0 || i != node.newest || !marked[k])
                goes[at(node.corner[i])] = 0;
    }
    std::size_t removed = 0;
    for (const std::uint8_t g : goes)
        removed += g;
    if (removed == 0)
        return 0;
    for (const Index number : leaf) {
        const Node &node = _nodes[at(number)];
        if (node.parent >= 0 && goes[at(node.corner[node.newest])])
            _nodes[at(node.parent)].child = -1;
    }
    drop_unused();
    return removed;
}

void BisectedMesh::drop_unused() {
    // Nodes that can still be reached, in the old order: parents come before children.
    std::vector<char> is_kept(_nodes.size(), 0);
    std::vector<Index> new_node(_nodes.size(), -1);
    Index count = 0;
    for (std::size_t n = 0; n < _nodes.size(); ++n) {
        const Index parent = _nodes[n].parent;
        is_kept[n] = parent < 0 || (is_kept[at(parent)] && _nodes[at(parent)].child >= 0);
        if (is_kept[n])
            new_node[n] = count++;
    }
    std::vector<Node> nodes;
    nodes.reserve(at(count));
    std::vector<char> is_used(_points.size(), 0);
    for (std::size_t n = 0; n < _nodes.size(); ++n) {
        if (!is_kept[n])
            continue;
        Node node = _nodes[n];
        if (node.parent >= 0)
            node.parent = new_node[at(node.parent)];
        if (node.child >= 0)
            node.child = new_node[at(node.child)];
        for (const Index v : node.corner)
            is_used[at(v)] = 1;
        nodes.push_back(node);
    }
    std::vector<Index> number(_points.size(), -1);
    std::size_t kept = 0;
    for (std::size_t v = 0; v < _points.size(); ++v) {
        if (!is_used[v])
            continue;
        number[v] = static_cast<Index>(kept);
        _points[kept] = _points[v];
        _parents[kept] = _parents[v];
        ++kept;
    }
    _points.resize(kept);
    _parents.resize(kept);
    _middles = EdgeTable(kept);
    for (std::size_t v = 0; v < kept; ++v)
        if (_parents[v][0] >= 0) {
            for (Index &end : _parents[v])
                end = number[at(end)];
            _middles.insert(_parents[v][0], _parents[v][1], static_cast<Index>(v));
        }
    for (Node &node : nodes)
        for (Index &v : node.corner)
            v = number[at(v)];
    for (Cell &cell : _given)
        for (Index &v : cell)
            v = number[at(v)];
    _nodes = std::move(nodes);
    _cut_in_sweep.assign(kept, 0);
}

} // namespace fastsim
