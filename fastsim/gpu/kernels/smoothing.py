"""Forces of smoothed tetrahedra: (S1) to (S5) of core/mechanics/smoothed_tet4.hpp.

1. each cell's 2 V_c E_c
2. at each edge mu / (36 V_e) times the sum of its cells': a sixth of 2 mu E_e
3. at each node lmbda / (32 V_n) times the sum of their traces: a quarter of lmbda theta_n
4. each cell's S_c, the sum of six edges' and of four nodes' on its diagonal, and its forces

Edges and nodes sum their cells always in the same order.
"""

from palpate.fastsim.gpu.kernels.elasticity import make_det, make_formulas
from palpate.fastsim.gpu.kernels.kit import Kit


def make(kit: Kit) -> None:
    """Make the four kernels, over bodies and cells, edges or nodes."""
    wp, real, vec6, mat33 = kit.wp, kit.real, kit.vec6, kit.mat33
    gradient_of, twice_strain, first_stress, spread_forces = make_formulas(kit)
    det_of = make_det(kit)

    @kit.kernel
    def strain_cells(go, displacement, corners, gradients, volumes, is_green, strains, inverted):
        body, cell = wp.tid()
        if go[body] == 0:
            return
        h = gradient_of(displacement, body, corners[cell], gradients[cell])
        e = volumes[cell] * twice_strain(h, is_green)
        strains[body, cell] = vec6(e[0, 0], e[1, 1], e[2, 2], e[0, 1], e[0, 2], e[1, 2])
        if is_green != 0 and not det_of(h) > real(0.0):
            inverted[body] = 1

    @kit.kernel
    def smooth_edges(go, strains, start, entries, weights, kinds, moduli, stresses):
        body, edge = wp.tid()
        if go[body] == 0:
            return
        total = vec6()
        for k in range(start[edge], start[edge + 1]):
            total += strains[body, entries[k]]
        stresses[body, edge] = (weights[edge] * moduli[body, 2 * kinds[edge] + 1]) * total

    @kit.kernel
    def smooth_nodes(go, strains, start, entries, weights, kinds, moduli, pressures):
        body, node = wp.tid()
        if go[body] == 0:
            return
        total = real(0.0)
        for k in range(start[node], start[node + 1]):
            e = strains[body, entries[k]]
            total += e[0] + e[1] + e[2]
        pressures[body, node] = weights[node] * moduli[body, 2 * kinds[node]] * total

    @kit.kernel
    def force_smoothed_cells(
        go, displacement, corners, gradients, volumes, cell_edges, cell_nodes, stresses, pressures,
        is_green, is_atomic, cell_forces, force,
    ):  # fmt: skip
        body, cell = wp.tid()
        if go[body] == 0:
            return
        total = vec6()
        edges = cell_edges[cell]
        for k in range(6):
            total += stresses[body, edges[k]]
        spread = real(0.0)
        nodes = cell_nodes[cell]
        for k in range(4):
            spread += pressures[body, nodes[k]]
        s = volumes[cell] * mat33(
            total[0] + spread, total[3], total[4],
            total[3], total[1] + spread, total[5],
            total[4], total[5], total[2] + spread,
        )  # fmt: skip
        c = corners[cell]
        g = gradients[cell]
        h = gradient_of(displacement, body, c, g)
        f = first_stress(h, s, is_green) * wp.transpose(g)
        spread_forces(f, body, cell, c, is_atomic, cell_forces, force)
