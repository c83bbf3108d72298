"""Forces of smoothed tetrahedra: (S1) to (S5) of core/mechanics/smoothed_tet4.hpp.

Under Green strain also what core/mechanics/compression_blend.hpp adds where they are compressed.

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
    def smooth_edges(
        go, strains, start, entries, weights, kinds, moduli, volumes, is_green, stresses, blends,
        presses,
    ):  # fmt: skip
        body, edge = wp.tid()
        if go[body] == 0:
            return
        total = vec6()
        squares = real(0.0)
        for k in range(start[edge], start[edge + 1]):
            e = strains[body, entries[k]]
            total += e
            sides = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
            squared = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + real(2.0) * sides
            squares += squared / volumes[entries[k]]
        weight = weights[edge]
        lmbda = moduli[body, 2 * kinds[edge]]
        mu = moduli[body, 2 * kinds[edge] + 1]
        mean = (real(3.0) * weight) * total
        rate = real(-2.0) * wp.min(lmbda / mu + real(2.0), real(6.0))
        x = wp.clamp(rate * (mean[0] + mean[1] + mean[2]) - real(0.4), real(0.0), real(1.0))
        if is_green == 0:
            x = real(0.0)
        beta = x * x * (real(3.0) - real(2.0) * x)
        slope = rate * real(6.0) * x * (real(1.0) - x)
        sides = mean[3] * mean[3] + mean[4] * mean[4] + mean[5] * mean[5]
        squared = mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2] + real(2.0) * sides
        variance = real(1.5) * weight * squares - squared
        stresses[body, edge] = (weight * mu * (real(1.0) - beta)) * total
        blends[body, edge] = mu * beta / real(6.0)
        presses[body, edge] = mu * slope * variance / real(6.0)

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
        go, displacement, corners, gradients, volumes, cell_edges, cell_nodes, strains, stresses,
        blends, presses, pressures, is_green, is_atomic, cell_forces, force,
    ):  # fmt: skip
        body, cell = wp.tid()
        if go[body] == 0:
            return
        total = vec6()
        edges = cell_edges[cell]
        own = real(0.0)
        spread = real(0.0)
        for k in range(6):
            total += stresses[body, edges[k]]
            own += blends[body, edges[k]]
            spread += presses[body, edges[k]]
        total += (own / volumes[cell]) * strains[body, cell]
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
