"""From the table of a tool to the rigid body that presses, in SI units."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
    ToolShape,
)
from palpate.meshes.smooth_path import smooth_path
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.geometry import inside_folder, load_surface
from palpate.validation.case.motion_schema import DriveSpec, PoseSpec, ToolSpec
from palpate.validation.case.regions import select_facets
from palpate.validation.case.units import Units


def build_tool(spec: ToolSpec, mesh: TetMesh, units: Units, folder: Path, what: str) -> RigidTool:
    """A tool in SI units, with the facets that it may touch.

    Args:
        spec: Its table.
        mesh: The case's [m].
        units: The case's.
        folder: Where the case file lies: a tool's surface is read from there.
        what: "tool 1": for messages.

    Raises:
        InputError: A region that selects nothing, a surface that bounds no solid, a bad value.
    """
    facets = (
        np.zeros((0, 3), dtype=np.int32)
        if spec.region is None
        else select_facets(mesh, spec.region, units, what)
    )
    path = ToolPath(
        np.array([pose.time for pose in spec.pose]),
        np.array([units.place(pose.position) for pose in spec.pose]),
        np.array([_quaternion(pose) for pose in spec.pose]),
    )
    path = smooth_path(path) if spec.smooth else path
    return RigidTool(
        _shape(spec, units, folder),
        path,
        spec.friction_coefficient,
        facets,
        _drive(spec.drive, units),
    )


def _drive(spec: DriveSpec | None, units: Units) -> ForceDrive | None:
    if spec is None:
        return None
    table = spec.amplitude
    amplitude = TabularAmplitude(table.times, table.factors, table.smooth)
    return ForceDrive(spec.direction, units.newtons(spec.force), amplitude, spec.mass)


def _shape(spec: ToolSpec, units: Units, folder: Path) -> ToolShape:
    metres = units.metres
    match spec:
        case ToolSpec(shape="sphere", radius=float(radius)):
            return SphereShape(metres(radius))
        case ToolSpec(shape="capsule", radius=float(radius), half_length=float(half)):
            return CapsuleShape(metres(radius), metres(half))
        case ToolSpec(shape="box", half_widths=(a, b, c)):
            return BoxShape(units.place((a, b, c)))
        case ToolSpec(shape="surface", surface=str(name)):
            path = inside_folder(folder, name)
            return SurfaceShape(load_surface(path, scale=metres(1.0)).surface)
        case _:
            return PlaneShape()


def _quaternion(pose: PoseSpec) -> list[float]:
    """Unit quaternion (w, x, y, z) of a turn about an axis."""
    if pose.rotation is None:
        return [1.0, 0.0, 0.0, 0.0]
    half = 0.5 * math.radians(pose.rotation.angle_deg)
    # In parts of its largest, so that no square is lost or without end.
    largest = max(abs(a) for a in pose.rotation.axis)
    axis = [a / largest for a in pose.rotation.axis]
    return [math.cos(half), *(math.sin(half) * a / math.hypot(*axis) for a in axis)]
