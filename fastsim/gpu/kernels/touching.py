"""Forces between rigid tools and vertices of the boundary: core/explicit/tool_touch.hpp.

The penalty f = k A max(0, -g) n, the constraint (the force that puts a vertex onto the tool at the
end of the step), and Coulomb's friction. In double precision, whatever the body's; the force on
the body is rounded to its precision, and exactly that acts back on the tool.
"""

from typing import Any

from palpate.fastsim.gpu.kernels.kit import Kit
from palpate.fastsim.gpu.kernels.tool_shapes import make_shapes

# Vertices whose forces one launch sums; a second sums these.
CHUNK = 64
# Rows of the loads on a tool.
MOST_CORRECTIONS = 6
# Least cosine between the normals of a step's two ends: beyond it the vertex turned a corner.
NEARLY_ONE_NORMAL = 0.5


def make_tool(wp: Any) -> Any:
    """The structure of a tool, as `TouchSettings` of the core."""

    @wp.struct
    class Tool:
        shape: int
        is_constraint: int
        size: wp.vec3d
        friction: wp.float64
        reach: wp.float64
        deepest: wp.float64
        direction: wp.vec3d
        mass: wp.float64

    return Tool


def make(kit: Kit) -> None:
    """Make the kernels, over bodies and vertices, chunks of these, and tools."""
    wp, real, vec3 = kit.wp, kit.real, kit.vec3
    f64, vec3d, mat33d, vec2d = wp.float64, wp.vec3d, wp.mat33d, wp.vec2d
    gap_on_way, way_from = make_shapes(kit)
    Tool = kit.kernels["Tool"] = make_tool(wp)
    vec13 = wp.types.vector(13, f64)
    chunk_size = wp.constant(CHUNK)
    most_corrections = wp.constant(MOST_CORRECTIONS)
    nearly_one_normal = wp.constant(f64(NEARLY_ONE_NORMAL))

    @kit.func
    def double(v: vec3):
        return vec3d(f64(v[0]), f64(v[1]), f64(v[2]))

    @kit.func
    def origin_of(step: vec13, tool: Tool, offset: f64):
        return vec3d(step[0], step[1], step[2]) + offset * tool.direction

    @kit.func
    def rotation_of(step: vec13):
        return mat33d(
            step[3], step[4], step[5], step[6], step[7], step[8], step[9], step[10], step[11]
        )

    @kit.func
    def gap_at(tool: Tool, origin: vec3d, turn: mat33d, position: vec3d, begin: vec3d, known: int):
        own = wp.transpose(turn) * (position - origin)
        found = gap_on_way(tool.shape, tool.size, own, begin, known)
        n = turn * vec3d(found[0], found[1], found[2])
        return wp.vec4d(n[0], n[1], n[2], found[3])

    @kit.func
    def constraint_force(
        tool: Tool,
        origin: vec3d,
        turn: mat33d,
        end: vec3d,
        mobile: vec3d,
        gap: wp.vec4d,
        started: vec3d,
        begin: vec3d,
        known: int,
    ):
        # Along the normal where the step starts, or the force would push on the slip.
        # A vertex with fixed components leaves the tool along another line than its normal.
        rounds = int(most_corrections)
        if mobile[0] == mobile[1] and mobile[1] == mobile[2]:
            rounds = 1
        f = vec3d()
        last = gap
        for _k in range(rounds):
            n = vec3d(last[0], last[1], last[2])
            line = n
            if wp.dot(started, n) > nearly_one_normal:
                line = started
            give = wp.dot(mobile, wp.cw_mul(n, line))
            if last[3] < f64(0.0) and give > f64(0.0):
                f += (-last[3] / give) * line
                if rounds > 1:
                    last = gap_at(tool, origin, turn, end + wp.cw_mul(mobile, f), begin, known)
        return f

    @kit.func
    def friction_force(friction: f64, slides: vec3d, mobile: vec3d, f: vec3d, normal: vec3d):
        # What stops the slip of the step ahead, at most mu times the normal force.
        slip = slides - wp.dot(slides, normal) * normal
        stop = vec3d()
        for j in range(3):
            if mobile[j] > f64(0.0):
                stop[j] = -slip[j] / mobile[j]
        size = wp.length(stop)
        most = friction * wp.length(f)
        if size > most:
            stop = (most / size) * stop
        return stop

    @kit.kernel
    def clear_touch(go, vertices, unknown, touch):
        body, k = wp.tid()
        if go[body] == 0:
            return
        touch[body, vertices[k]] = vec3()
        unknown[body] = 0

    @kit.kernel
    def touch_vertices(
        go, row, number, tools: wp.array2d(dtype=Tool), tool_steps: wp.array3d(dtype=vec13),
        increments, offsets, first, vertices, stiffness, keep, rest, displacement, increment,
        external, mobility, begins: wp.array2d(dtype=vec3d), is_known, force, touch, acting,
        vertex_moments, extremes,
    ):  # fmt: skip
        body, k = wp.tid()
        if go[body] == 0:
            return
        at = first + k
        point = vertices[at]
        tool = tools[body, number]
        offset = offsets[body, number]
        now = tool_steps[body, row[body], number]
        next = tool_steps[body, row[body] + 1, number]
        now_origin = origin_of(now, tool, offset)
        # What pushes a driven tool is not known yet: as fast as in the last step.
        next_origin = origin_of(next, tool, offset + increments[body, number])
        now_turn = rotation_of(now)
        next_turn = rotation_of(next)
        position = rest[point] + double(displacement[body, point])
        d = increment[body, point]
        acting[body, at] = vec3d()
        vertex_moments[body, at] = vec3d()
        extremes[body, at] = vec2d(f64(wp.inf), f64(wp.max(wp.abs(d))))
        # Near the tool? The box of its shape, turned.
        if tool.shape != 3:
            own_half = tool.size
            if tool.shape == 0:
                own_half = vec3d(tool.size[0], tool.size[0], tool.size[0])
            if tool.shape == 1:
                own_half = vec3d(tool.size[0], tool.size[0], tool.size[0] + tool.size[1])
            arm = position - now_origin
            for i in range(3):
                reach = tool.reach
                for j in range(3):
                    reach += wp.abs(now_turn[i, j]) * own_half[j]
                if wp.abs(arm[i]) > reach:
                    return
        way = begins[body, at]
        known = is_known[body, at]
        if tool.shape == 2:
            own = wp.transpose(now_turn) * (position - now_origin)
            begins[body, at] = way_from(tool.size, own, way, known)
            is_known[body, at] = 1
        mobile = double(mobility[body, point])
        ahead = f64(keep[body]) * double(d) + wp.cw_mul(
            mobile, double(external[body, point] - force[body, point])
        )
        f = vec3d()
        normal = vec3d()
        if tool.is_constraint != 0:
            new_way = begins[body, at]
            new_known = is_known[body, at]
            gap = gap_at(tool, next_origin, next_turn, position + ahead, new_way, new_known)
            extremes[body, at] = vec2d(gap[3], f64(wp.max(wp.abs(d))))
            if not gap[3] < f64(0.0):
                return
            normal = vec3d(gap[0], gap[1], gap[2])
            started = normal
            if tool.shape == 0 or tool.shape == 1:
                g = gap_at(tool, now_origin, now_turn, position, new_way, new_known)
                started = vec3d(g[0], g[1], g[2])
            f = constraint_force(
                tool,
                next_origin,
                next_turn,
                position + ahead,
                mobile,
                gap,
                started,
                new_way,
                new_known,
            )
        else:
            gap = gap_at(tool, now_origin, now_turn, position, way, known)
            extremes[body, at] = vec2d(gap[3], f64(wp.max(wp.abs(d))))
            if not gap[3] < f64(0.0):
                return
            normal = vec3d(gap[0], gap[1], gap[2])
            f = (-gap[3] * stiffness[body, at]) * normal
        if tool.friction > f64(0.0):
            end = position + ahead + wp.cw_mul(mobile, f)
            came = now_origin + now_turn * (wp.transpose(next_turn) * (end - next_origin))
            f = f + friction_force(tool.friction, came - position, mobile, f, normal)
        rounded = vec3(real(f[0]), real(f[1]), real(f[2]))
        force[body, point] = force[body, point] - rounded
        touch[body, point] = touch[body, point] + rounded
        acts = double(rounded)
        acting[body, at] = -acts
        vertex_moments[body, at] = -wp.cross(position - now_origin, acts)

    @kit.kernel
    def sum_touch_chunks(
        go, first, last: int, acting, vertex_moments, extremes, chunk_forces, chunk_moments,
        chunk_extremes,
    ):  # fmt: skip
        body, chunk = wp.tid()
        if go[body] == 0:
            return
        f = vec3d()
        m = vec3d()
        gap = f64(wp.inf)
        fastest = f64(0.0)
        begin = first + chunk_size * chunk
        for k in range(begin, wp.min(begin + chunk_size, last)):
            f += acting[body, k]
            m += vertex_moments[body, k]
            gap = wp.min(gap, extremes[body, k][0])
            fastest = wp.max(fastest, extremes[body, k][1])
        chunk_forces[body, chunk] = f
        chunk_moments[body, chunk] = m
        chunk_extremes[body, chunk] = vec2d(gap, fastest)

    @kit.kernel
    def sum_touch(
        go, number, num_chunks, tools: wp.array2d(dtype=Tool), chunk_forces, chunk_moments,
        chunk_extremes, forces, moments, gaps, unknown,
    ):  # fmt: skip
        body = wp.tid()
        if go[body] == 0:
            return
        f = vec3d()
        m = vec3d()
        gap = f64(wp.inf)
        fastest = f64(0.0)
        for chunk in range(num_chunks):
            f += chunk_forces[body, chunk]
            m += chunk_moments[body, chunk]
            gap = wp.min(gap, chunk_extremes[body, chunk][0])
            fastest = wp.max(fastest, chunk_extremes[body, chunk][1])
        forces[body, number] = f
        moments[body, number] = m
        gaps[body, number] = gap
        deepest = tools[body, number].deepest
        # So deep, or so fast, that a vertex may come out on the other side.
        if not (gap >= -deepest and fastest <= f64(0.5) * deepest):
            unknown[body] = 1

    @kit.kernel
    def move_tools(
        go, inverted, row, begun, time_step, tools: wp.array2d(dtype=Tool),
        tool_steps: wp.array3d(dtype=vec13), forces, impulses, increments, offsets,
    ):  # fmt: skip
        body, number = wp.tid()
        if go[body] == 0 or inverted[body] != 0:
            return
        dt = time_step[body]
        f = forces[body, number]
        impulses[body, number] = impulses[body, number] + dt * f
        tool = tools[body, number]
        if tool.mass > f64(0.0):
            drive = tool_steps[body, row[body], number]
            total = drive[12] + wp.dot(tool.direction, f)
            # From rest: a(-dt) = a(dt), eq. 13.
            part = f64(1.0)
            if begun[body] == 0:
                part = f64(0.5)
            step = increments[body, number] + part * dt * dt * total / tool.mass
            increments[body, number] = step
            offsets[body, number] = offsets[body, number] + step
