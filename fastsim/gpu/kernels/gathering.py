"""Forces of cells summed at points, in the order of the cells: the same bits in every run."""

from palpate.fastsim.gpu.kernels.kit import Kit


def make(kit: Kit) -> None:
    """Make the kernel, over bodies and points."""
    wp, vec3 = kit.wp, kit.vec3

    @kit.kernel
    def gather_forces(go, start, entries, cell_forces, force):
        body, point = wp.tid()
        if go[body] == 0:
            return
        total = vec3()
        for k in range(start[point], start[point + 1]):
            total += cell_forces[body, entries[k]]
        force[body, point] = total
