"""Loads and supports of a body: dead loads, follower pressure, supports that move or slide.

A history is a factor over time, to which loads and supports refer. `factors` has them for the time
before each step and after the last, `changes` their differences from row to row, taken in double
precision by the host. As core/explicit/loads.hpp.
"""

from palpate.fastsim.gpu.kernels.kit import Kit


def make(kit: Kit) -> None:
    """Make the kernels, over bodies and points, facets or supports."""
    wp, real, vec3 = kit.wp, kit.real, kit.vec3
    # Of the larger of two factors: more is a jump, whose work is counted apart.
    jump = wp.constant(real(0.05))

    @kit.kernel
    def combine_loads(
        go, row, factors, histories: wp.array(dtype=int), dead, is_free, displacement, counted,
        given, external,
    ):  # fmt: skip
        body, point = wp.tid()
        if go[body] == 0:
            return
        total = vec3()
        for k in range(histories.shape[0]):
            total += factors[body, row[body], histories[k]] * dead[body, k, point]
        last = external[body, point]
        most = wp.max(wp.max(wp.abs(last)), wp.max(wp.abs(total)))
        if wp.max(wp.abs(total - last)) > jump * most:
            position = displacement[body, point]
            moved = wp.cw_mul(is_free[body, point], position - counted[body, point])
            given[body, point] = given[body, point] + wp.abs(wp.dot(last, moved))
            counted[body, point] = position
        external[body, point] = total

    @kit.kernel
    def press_facets(
        go, row, factors, points: wp.array(dtype=vec3), displacement, facets, pressures, histories,
        corner_forces,
    ):  # fmt: skip
        body, facet = wp.tid()
        if go[body] == 0:
            return
        c = facets[facet]
        # Rest edges and displacement differences apart: a small motion keeps its digits.
        x = displacement[body, c[0]]
        p = (points[c[1]] - points[c[0]]) + (displacement[body, c[1]] - x)
        q = (points[c[2]] - points[c[0]]) + (displacement[body, c[2]] - x)
        # A third of half the area vector times the pressure, to each corner.
        factor = real(0.0)
        if histories[body, facet] >= 0:
            factor = factors[body, row[body], histories[body, facet]]
        corner_forces[body, facet] = (factor * pressures[body, facet] / real(-6.0)) * wp.cross(p, q)

    @kit.kernel
    def press_points(go, pressed, start, entries, corner_forces, pressure, force):
        body, k = wp.tid()
        if go[body] == 0:
            return
        total = vec3()
        for at in range(start[k], start[k + 1]):
            total += corner_forces[body, entries[at]]
        point = pressed[k]
        pressure[body, point] = total
        force[body, point] = force[body, point] - total

    @kit.kernel
    def look_at_supports(
        go, row, begun, changes, moving, num_terms, values, histories: wp.array2d(dtype=wp.vec3i),
        force, pressure, increment, last, ahead, inner, given,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0:
            return
        point = moving[k]
        total = vec3()
        before = increment[body, point]
        pull = force[body, point] + pressure[body, point]
        moves = vec3()
        for t in range(num_terms):
            h = histories[body, num_terms * k + t]
            v = values[body, num_terms * k + t]
            for j in range(3):
                if h[j] >= 0:
                    total[j] = total[j] + changes[body, row[body], h[j]] * v[j]
                    moves[j] = real(1.0)
        # It moved before the start as it does after: no blow at the first step.
        if begun[body] == 0:
            before = wp.cw_mul(vec3(real(1.0), real(1.0), real(1.0)) - moves, before) + total
            increment[body, point] = before
        before = wp.cw_mul(moves, before)
        pull = wp.cw_mul(moves, pull)
        last[body, k] = before
        ahead[body, k] = total
        inner[body, k] = pull
        # What moves the support's own mass is not the free points'.
        work = real(0.5) * wp.dot(pull, total + before)
        given[body, point] = given[body, point] + wp.abs(work)

    @kit.kernel
    def move_supports(
        go, inverted, row, factors, moving, num_terms, values,
        histories: wp.array2d(dtype=wp.vec3i), ahead, increment, displacement,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0 or inverted[body] != 0:
            return
        point = moving[k]
        total = vec3()
        moves = vec3()
        for t in range(num_terms):
            h = histories[body, num_terms * k + t]
            v = values[body, num_terms * k + t]
            for j in range(3):
                if h[j] >= 0:
                    total[j] = total[j] + factors[body, row[body] + 1, h[j]] * v[j]
                    moves[j] = real(1.0)
        stays = vec3(real(1.0), real(1.0), real(1.0)) - moves
        displacement[body, point] = wp.cw_mul(stays, displacement[body, point]) + total
        increment[body, point] = wp.cw_mul(stays, increment[body, point]) + ahead[body, k]

    @kit.kernel
    def hold_slides(
        go, row, begun, changes, keep, speed_share, points, directions,
        values: wp.array2d(dtype=real), histories, external, mobility, increment, force,
        last: wp.array2d(dtype=real), ahead: wp.array2d(dtype=real), pull, given,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0:
            return
        point = points[k]
        mobile = mobility[body, point][0]
        for s in range(2 * k, 2 * k + 2):
            if histories[body, s] >= 0:
                n = directions[body, s]
                goal = changes[body, row[body], histories[body, s]] * values[body, s]
                d = increment[body, point]
                before = wp.dot(n, d)
                work = real(0.0)
                # It moved before the start as it does after, like all supports; the speed it has
                # then is its wall's, not gained from nothing.
                if begun[body] == 0:
                    d += (goal - before) * n
                    increment[body, point] = d
                    before = goal
                    work += speed_share[body] * goal * goal / mobile
                r = external[body, point] - force[body, point]
                next = wp.dot(n, keep[body] * d + mobile * r)
                size = (goal - next) / mobile
                force[body, point] = force[body, point] - size * n
                work += wp.abs(real(0.5) * size * (goal + before))
                last[body, s] = before
                ahead[body, s] = goal
                pull[body, s] = size
                given[body, point] = given[body, point] + work

    @kit.kernel
    def settle_slides(
        go, inverted, row, factors, points, directions, values: wp.array2d(dtype=real), histories,
        displacement,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0 or inverted[body] != 0:
            return
        for s in range(2 * k, 2 * k + 2):
            if histories[body, s] >= 0:
                n = directions[body, s]
                position = displacement[body, points[k]]
                goal = factors[body, row[body] + 1, histories[body, s]] * values[body, s]
                displacement[body, points[k]] = position - (wp.dot(n, position) - goal) * n

    @kit.kernel
    def count_pushes(go, inverted, pushed, is_free, pressure, touch, increment, given):
        body, k = wp.tid()
        if go[body] == 0 or inverted[body] != 0:
            return
        point = pushed[k]
        # What pushes a moving support passes straight through it.
        moved = wp.cw_mul(is_free[body, point], increment[body, point])
        work = wp.abs(wp.dot(pressure[body, point], moved))
        work += wp.abs(wp.dot(touch[body, point], moved))
        given[body, point] = given[body, point] + work
