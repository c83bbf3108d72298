"""Signed distance to the shapes of tools in their own frames, and by which face a box is entered.

In double precision, whatever the body's, as core/contact/tool_shape.hpp and box_faces.hpp. A gap
is four numbers: its normal, then the distance, negative inside.
"""

from typing import Any

from palpate.fastsim.gpu.kernels.kit import Kit

SPHERE, CAPSULE, BOX, HALF_SPACE = range(4)


def make_shapes(kit: Kit) -> tuple[Any, Any]:
    """`gap_on_way` and `way_from`."""
    wp = kit.wp
    f64, vec3d, vec4d = wp.float64, wp.vec3d, wp.vec4d
    is_sphere, is_capsule, is_box = (wp.constant(k) for k in (SPHERE, CAPSULE, BOX))
    # Of the smallest half width: nearer than this a vertex is still at the face it touches.
    touching = wp.constant(f64(1e-6))

    @kit.func
    def side_of(x: f64):
        side = f64(1.0)
        if x < f64(0.0):
            side = f64(-1.0)
        return side

    @kit.func
    def ball(position: vec3d, radius: f64, fallback: vec3d):
        r = wp.length(position)
        n = fallback
        if r > f64(0.0):
            n = position / r
        return vec4d(n[0], n[1], n[2], r - radius)

    @kit.func
    def box_gap(half: vec3d, position: vec3d):
        beyond = vec3d()
        outside = vec3d()
        num_outside = 0
        for i in range(3):
            beyond[i] = wp.abs(position[i]) - half[i]
            if beyond[i] > f64(0.0):
                outside[i] = side_of(position[i]) * beyond[i]
                num_outside += 1
        nearest = 0
        if beyond[1] > beyond[0]:
            nearest = 1
        if beyond[2] > beyond[nearest]:
            nearest = 2
        found = vec4d()
        if num_outside < 2:
            found[nearest] = side_of(position[nearest])
            found[3] = beyond[nearest]
        else:
            found = ball(outside, f64(0.0), vec3d(f64(0.0), f64(0.0), f64(1.0)))
        return found

    @kit.func
    def gap_of(shape: int, size: vec3d, position: vec3d):
        z_axis = vec3d(f64(0.0), f64(0.0), f64(1.0))
        found = vec4d(f64(0.0), f64(0.0), f64(1.0), position[2])
        if shape == is_sphere:
            found = ball(position, size[0], z_axis)
        elif shape == is_capsule:
            z = wp.clamp(position[2], -size[1], size[1])
            x_axis = vec3d(f64(1.0), f64(0.0), f64(0.0))
            found = ball(vec3d(position[0], position[1], position[2] - z), size[0], x_axis)
        elif shape == is_box:
            found = box_gap(size, position)
        return found

    @kit.func
    def slack_of(half: vec3d):
        return touching * wp.min(half)

    @kit.func
    def nearest_axis(half: vec3d, own: vec3d):
        nearest = 0
        for i in range(1, 3):
            if wp.abs(own[i]) - half[i] > wp.abs(own[nearest]) - half[nearest]:
                nearest = i
        return nearest

    @kit.func
    def entered_face(half: vec3d, own: vec3d, begin: vec3d, known: int):
        # The axis, times two, and one more for its positive side.
        axis = nearest_axis(half, own)
        side = side_of(own[axis])
        if known != 0:
            slack = slack_of(half)
            latest = f64(-1.0)
            for i in range(3):
                to = side_of(begin[i])
                beyond = wp.abs(begin[i]) - half[i]
                length = wp.abs(begin[i]) - to * own[i]
                # By an axis on which it is still outside it has crossed no plane.
                is_crossed = beyond > slack and length >= beyond - slack
                if is_crossed and beyond > latest * length:
                    latest = beyond / length
                    axis = i
                    side = to
        face = 2 * axis
        if side > f64(0.0):
            face = face + 1
        return face

    @kit.func
    def gap_on_way(shape: int, size: vec3d, own: vec3d, begin: vec3d, known: int):
        is_inside = 0
        if shape == is_box and known != 0:
            # What was put onto a side has to stay there, roundings or not.
            beyond = vec3d(
                wp.abs(own[0]) - size[0], wp.abs(own[1]) - size[1], wp.abs(own[2]) - size[2]
            )
            if wp.max(beyond) <= slack_of(size):
                is_inside = 1
        found = gap_of(shape, size, own)
        if is_inside != 0:
            face = entered_face(size, own, begin, known)
            axis = face // 2
            side = f64(2 * (face - 2 * axis) - 1)
            found = vec4d()
            found[axis] = side
            found[3] = side * own[axis] - size[axis]
        return found

    @kit.func
    def way_from(half: vec3d, own: vec3d, begin: vec3d, known: int):
        way = own
        near = nearest_axis(half, own)
        if side_of(own[near]) * own[near] - half[near] <= slack_of(half):
            # What touches the box begins straight in front of the face by which it came.
            face = entered_face(half, own, begin, known)
            axis = face // 2
            for i in range(3):
                way[i] = wp.clamp(own[i], -half[i], half[i])
            way[axis] = f64(2.0) * f64(2 * (face - 2 * axis) - 1) * half[axis]
        return way

    return gap_on_way, way_from
