"""Eq. 12 at each point, and the count of accepted steps of each body.

    (1 + c) d(t+dt) = (1 - c) d(t) + dt^2 M^-1 (F - R(a(t))),   a(t+dt) = a(t) + d(t+dt)

with c half the mass damping times dt, as core/explicit/central_difference.hpp. A body that has
stopped, or has made all its steps, is skipped (`go` is 0).
"""

from palpate.fastsim.gpu.kernels.kit import Kit

# Why a body stopped, as the core's StopReason counts.
NONE, INVERTED_CELL, OUT_OF_BOUNDS, ENERGY_GROWTH, DEEP_IN_TOOL = range(5)


def make(kit: Kit) -> None:
    """Make the kernels over bodies and points, and over bodies."""
    wp = kit.wp
    inverted_cell = wp.constant(INVERTED_CELL)
    out_of_bounds = wp.constant(OUT_OF_BOUNDS)
    deep_in_tool = wp.constant(DEEP_IN_TOOL)

    @kit.kernel
    def move_points(
        go, inverted, keep, limit, external, force, mobility, increment, displacement, outside
    ):
        body, point = wp.tid()
        if go[body] == 0 or inverted[body] != 0:
            return
        push = external[body, point] - force[body, point]
        ahead = keep[body] * increment[body, point] + wp.cw_mul(mobility[body, point], push)
        position = displacement[body, point] + ahead
        increment[body, point] = ahead
        displacement[body, point] = position
        # NaN counts as out of bounds: the comparison is false for it.
        if not (
            wp.abs(position[0]) <= limit
            and wp.abs(position[1]) <= limit
            and wp.abs(position[2]) <= limit
        ):
            outside[body] = 1

    @kit.kernel
    def finish_step(go, inverted, outside, unknown, row, last_row, since_good, begun, status):
        body = wp.tid()
        if go[body] == 0:
            return
        if inverted[body] != 0:
            status[body] = inverted_cell
        else:
            row[body] = row[body] + 1
            since_good[body] = since_good[body] + 1
            begun[body] = 1
            if outside[body] != 0:
                status[body] = out_of_bounds
            elif unknown[body] != 0:
                status[body] = deep_in_tool
        if status[body] != 0 or row[body] >= last_row[body]:
            go[body] = 0
