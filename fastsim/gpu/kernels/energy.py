"""The balance of energy step by step, and the monitor of its growth: core/explicit/energy.hpp.

Sums are in double precision, whatever the body's, since they decide whether a run is stopped. The
monitor sums the work of loads and supports by magnitudes, point by point, which is never less than
the work that the core counts.
"""

from palpate.fastsim.gpu.kernels.kit import Kit
from palpate.fastsim.gpu.kernels.stepping import ENERGY_GROWTH

# Rows of what a chunk of points adds up to: kinetic energy, what was given, how far.
NUM_SUMS = 3


def make(kit: Kit) -> None:
    """Make the kernels over bodies and points, chunks or supports, and over bodies."""
    wp, real, vec3 = kit.wp, kit.real, kit.vec3
    # As in core/explicit/energy.cpp, where it is said why.
    growth_limit = wp.constant(wp.float64(10.0))
    energy_growth = wp.constant(ENERGY_GROWTH)

    @kit.func
    def double(v: vec3):
        return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))

    @kit.kernel
    def balance_points(
        go, open_sums, begins, time_step, damping, mass, keep, is_free, external, pressure, touch,
        force, mobility, increment, kinetic, work, loss,
    ):  # fmt: skip
        body, point = wp.tid()
        if go[body] == 0:
            return
        free = is_free[body, point]
        push = external[body, point] - force[body, point]
        step = keep[body] * increment[body, point] + wp.cw_mul(mobility[body, point], push)
        ahead = double(wp.cw_mul(free, step))
        behind = double(wp.cw_mul(free, increment[body, point]))
        load = double(external[body, point])
        load += double(pressure[body, point]) + double(touch[body, point])
        dt = time_step[body]
        speed = (behind + ahead) / (wp.float64(2.0) * dt)
        squared = mass[body, point] * wp.dot(speed, speed)
        half_loss = wp.float64(0.5) * dt * damping[body] * squared
        kinetic[body, point] = wp.float64(0.5) * squared
        # (what is done, what will be once the step ahead is made)
        w = work[body, point]
        o = loss[body, point]
        if open_sums[body] != 0:
            w[0] = w[0] + w[1] + wp.float64(0.5) * wp.dot(load, behind)
            o[0] = o[0] + o[1] + half_loss
        w[1] = wp.float64(0.0)
        o[1] = wp.float64(0.0)
        if begins != 0:
            w[1] = wp.float64(0.5) * wp.dot(load, ahead)
            o[1] = half_loss
        work[body, point] = w
        loss[body, point] = o

    @kit.kernel
    def balance_supports(
        go, open_sums, begins, time_step, damping, mass, moving, last, ahead, inner, kinetic, work,
        loss,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0:
            return
        point = moving[k]
        dt = time_step[body]
        behind = double(last[body, k])
        next = double(ahead[body, k])
        m = mass[body, point]
        speed = (behind + next) / (wp.float64(2.0) * dt)
        pull = double(inner[body, k]) + m * ((next - behind) / (dt * dt) + damping[body] * speed)
        squared = m * wp.dot(speed, speed)
        half_loss = wp.float64(0.5) * dt * damping[body] * squared
        kinetic[body, point] = kinetic[body, point] + wp.float64(0.5) * squared
        w = work[body, point]
        o = loss[body, point]
        if open_sums[body] != 0:
            w[0] = w[0] + wp.float64(0.5) * wp.dot(pull, behind)
            o[0] = o[0] + half_loss
        if begins != 0:
            w[1] = w[1] + wp.float64(0.5) * wp.dot(pull, next)
            o[1] = o[1] + half_loss
        work[body, point] = w
        loss[body, point] = o

    @kit.kernel
    def balance_slides(
        go, open_sums, begins, points, last: wp.array2d(dtype=real), ahead: wp.array2d(dtype=real),
        pull, work,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0:
            return
        w = work[body, points[k]]
        for s in range(2 * k, 2 * k + 2):
            half = wp.float64(0.5) * wp.float64(pull[body, s])
            if open_sums[body] != 0:
                w[0] = w[0] + half * wp.float64(last[body, s])
            if begins != 0:
                w[1] = w[1] + half * wp.float64(ahead[body, s])
        work[body, points[k]] = w

    @kit.kernel
    def open_balance(go, begins, open_sums):
        body = wp.tid()
        if go[body] != 0:
            open_sums[body] = begins

    @kit.kernel
    def sum_chunks(
        status, num_chunks, num_points, mass, is_free, external, increment, displacement, counted,
        given, sums,
    ):  # fmt: skip
        body, chunk = wp.tid()
        if status[body] != 0:
            return
        squared = wp.float64(0.0)
        total = wp.float64(0.0)
        furthest = wp.float64(0.0)
        for point in range(chunk, num_points, num_chunks):
            free = is_free[body, point]
            position = displacement[body, point]
            work = wp.dot(external[body, point], wp.cw_mul(free, position - counted[body, point]))
            counted[body, point] = position
            sum = given[body, point] + wp.abs(work)
            given[body, point] = sum
            total += wp.float64(sum)
            d = double(wp.cw_mul(free, increment[body, point]))
            squared += mass[body, point] * wp.dot(d, d)
            furthest = wp.max(furthest, wp.float64(wp.max(wp.abs(position))))
        sums[body, chunk] = wp.vec3d(squared, total, furthest)

    @kit.kernel
    def judge_growth(
        num_chunks, sums, time_step, at_start, total_mass, rounding, status, since_good, go, is_good
    ):
        body = wp.tid()
        is_good[body] = 0
        if status[body] != 0:
            return
        squared = wp.float64(0.0)
        total = at_start[body]
        furthest = wp.float64(0.0)
        for chunk in range(num_chunks):
            s = sums[body, chunk]
            squared += s[0]
            total += s[1]
            furthest = wp.max(furthest, s[2])
        dt = time_step[body]
        half = wp.float64(0.5)
        speed = rounding * furthest / dt
        # NaN counts as growth: the comparison is false for it.
        allowed = growth_limit * total + half * total_mass[body] * speed * speed
        if half * squared / (dt * dt) <= allowed:
            is_good[body] = 1
            since_good[body] = 0
        else:
            status[body] = energy_growth
            go[body] = 0

    @kit.kernel
    def keep_good(is_good, increment, displacement, good_increment, good_displacement):
        body, point = wp.tid()
        if is_good[body] != 0:
            good_increment[body, point] = increment[body, point]
            good_displacement[body, point] = displacement[body, point]
