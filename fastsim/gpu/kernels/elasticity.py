"""Forces of linear tetrahedra: deformation gradient, strain, stress, force (eq. 1-8).

    H = du/dX,  2 E = H + H^T (+ H^T H for Green strain),  S = lmbda tr(E) I + 2 mu E,
    P = S (+ H S),  f_a = V P g_a

From H and not from F^T F - I: no cancellation. As core/explicit/step_kernel.inl.
"""

from typing import Any

from palpate.fastsim.gpu.kernels.kit import Kit


def make_formulas(kit: Kit) -> tuple[Any, Any, Any, Any]:
    """H of a cell, twice its strain, P of its S, and its corners' forces put where they go."""
    wp, vec3, mat33 = kit.wp, kit.vec3, kit.mat33

    @kit.func
    def gradient_of(
        displacement: wp.array2d(dtype=vec3), body: int, corners: wp.vec4i, gradients: mat33
    ):
        # Differences first: a body far from where it rests keeps its digits.
        origin = displacement[body, corners[0]]
        edges = wp.matrix_from_cols(
            displacement[body, corners[1]] - origin,
            displacement[body, corners[2]] - origin,
            displacement[body, corners[3]] - origin,
        )
        return edges * gradients

    @kit.func
    def twice_strain(h: mat33, is_green: int):
        e = h + wp.transpose(h)
        if is_green != 0:
            e += wp.transpose(h) * h
        return e

    @kit.func
    def first_stress(h: mat33, s: mat33, is_green: int):
        p = s
        if is_green != 0:
            p += h * s
        return p

    @kit.func
    def spread_forces(
        f: mat33,
        body: int,
        cell: int,
        c: wp.vec4i,
        is_atomic: int,
        cell_forces: wp.array2d(dtype=vec3),
        force: wp.array2d(dtype=vec3),
    ):
        f1 = vec3(f[0, 0], f[1, 0], f[2, 0])
        f2 = vec3(f[0, 1], f[1, 1], f[2, 1])
        f3 = vec3(f[0, 2], f[1, 2], f[2, 2])
        f0 = -(f1 + f2 + f3)
        if is_atomic != 0:
            wp.atomic_add(force, body, c[0], f0)
            wp.atomic_add(force, body, c[1], f1)
            wp.atomic_add(force, body, c[2], f2)
            wp.atomic_add(force, body, c[3], f3)
        else:
            cell_forces[body, 4 * cell] = f0
            cell_forces[body, 4 * cell + 1] = f1
            cell_forces[body, 4 * cell + 2] = f2
            cell_forces[body, 4 * cell + 3] = f3

    return gradient_of, twice_strain, first_stress, spread_forces


def make_det(kit: Kit) -> Any:
    """Det F of H."""
    real, mat33 = kit.real, kit.mat33

    @kit.func
    def det_of(h: mat33):
        one = real(1.0)
        a = h[0, 0] + one
        b = h[1, 1] + one
        c = h[2, 2] + one
        return (
            a * (b * c - h[1, 2] * h[2, 1])
            - h[0, 1] * (h[1, 0] * c - h[1, 2] * h[2, 0])
            + h[0, 2] * (h[1, 0] * h[2, 1] - b * h[2, 0])
        )

    return det_of


def make(kit: Kit) -> None:
    """Make the kernel for linear tetrahedra, over bodies and cells."""
    wp, real, vec3 = kit.wp, kit.real, kit.vec3
    gradient_of, twice_strain, first_stress, spread_forces = make_formulas(kit)
    det_of = make_det(kit)

    @kit.kernel
    def force_cells(
        go, displacement, corners, gradients, volumes, kinds, num_kinds, moduli, is_green,
        is_atomic, cell_forces, force, inverted,
    ):  # fmt: skip
        body, cell = wp.tid()
        if go[body] == 0:
            return
        kind = 0
        if num_kinds > 1:
            kind = kinds[cell]
        c = corners[cell]
        g = gradients[cell]
        h = gradient_of(displacement, body, c, g)
        e = twice_strain(h, is_green)
        volume = volumes[cell]
        spread = real(0.5) * moduli[body, 2 * kind] * volume * wp.trace(e)
        s = (moduli[body, 2 * kind + 1] * volume) * e
        s += wp.diag(vec3(spread, spread, spread))
        f = first_stress(h, s, is_green) * wp.transpose(g)
        # NaN counts as inverted: the comparison is false for it.
        if is_green != 0 and not det_of(h) > real(0.0):
            inverted[body] = 1
        spread_forces(f, body, cell, c, is_atomic, cell_forces, force)
