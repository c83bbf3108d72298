"""A picture of a case before it is solved: body, supports, loads and tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.preview.acting import Acting, acting, area_vectors
from palpate.validation.preview.tool_surfaces import tool_surface
from palpate.validation.report.pictures import draw_in_child

_BY = ("pyvista", "matplotlib")
# Lines of a path that is drawn.
_POSES = 60


def draw_case(case: Case, path: Path, *, by: tuple[str, ...] = _BY) -> None:
    """Write a .png; pyvista draws it where it can, matplotlib elsewhere.

    Args:
        case: To be drawn.
        path: A file of that name is replaced.
        by: Who may draw, in this order.

    Raises:
        InputError: Neither can.
    """
    modules = [f"palpate.validation.preview.draw_{one}" for one in by]
    made = draw_in_child(_arrays(case), modules)
    if "case" not in made:
        raise InputError(f"{path}: no picture could be drawn; install pyvista or matplotlib")
    with atomic_path(path) as temporary:
        temporary.write_bytes(made["case"])


def _arrays(case: Case) -> dict[str, NDArray[Any]]:
    """What is drawn, in the case's length unit."""
    problem, unit = case.problem, case.spec.units.length
    mesh, scale = problem.mesh, LENGTH[unit]
    points = mesh.points / scale
    reach = float(np.ptp(points, axis=0).max())
    loads = [acting(problem, load) for load in problem.loads]
    forces = np.array([load.force for load in loads]).reshape(-1, 3)
    largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
    # Longer for more force, but the smallest is seen too.
    lengths = np.linalg.norm(forces, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = np.nan_to_num(forces / lengths) * (0.12 + 0.18 * lengths / (largest or 1.0))
    arrows = shown * reach
    starts = [
        _start(points, found, found.center / scale, arrow)
        for found, arrow in zip(loads, arrows, strict=True)
    ]
    arrays: dict[str, NDArray[Any]] = {
        "points": points,
        "facets": mesh.boundary_facets,
        "held": _facets([support.facets for support in problem.supports]),
        "held_points": points[_points(problem.supports)],
        "pushed": _facets([load.facets for load in loads]),
        "starts": np.array(starts).reshape(-1, 3),
        "arrows": arrows,
        "title": np.array(f"{case.name}: {case.title}"),
        "unit": np.array(unit),
        "num_tools": np.array(len(problem.tools)),
    }
    for number, tool in enumerate(problem.tools):
        own, facets = tool_surface(tool, reach * scale)
        times = np.linspace(tool.path.times[0], tool.path.times[-1], _POSES)
        poses = [tool.path.pose_at(float(time)) for time in times]
        arrays[f"tool_{number}_facets"] = facets
        arrays[f"tool_{number}_path"] = np.array([place for place, _ in poses]) / scale
        for name, (place, turn) in (("start", poses[0]), ("end", poses[-1])):
            arrays[f"tool_{number}_{name}"] = (own @ turn.T + place) / scale
    return arrays


def _start(
    points: NDArray[Any], load: Acting, center: NDArray[Any], arrow: NDArray[Any]
) -> NDArray[Any]:
    """Where an arrow begins that is clear of the body: a push ends on it, a pull begins there."""
    length = float(np.linalg.norm(arrow))
    if length == 0.0:
        return center
    direction = arrow / length
    if load.kind == "point force":
        return np.asarray(center - arrow)
    outward = area_vectors(points, load.facets).sum(axis=0)
    is_pull = bool(outward @ arrow > 0.0)
    # Where the line of the force meets the loaded part, about: what is nearest to the line.
    places = points[load.facets].mean(axis=1) if len(load.facets) else points
    along = (places - center) @ direction
    beside = np.linalg.norm(places - center - along[:, None] * direction, axis=1)
    beside[along < -1e-9 * length if is_pull else along > 1e-9 * length] = np.inf
    met = center + direction * float(along[beside.argmin()])
    return np.asarray(met if is_pull else met - arrow)


def _facets(parts: list[NDArray[Any]]) -> NDArray[Any]:
    known = [part for part in parts if len(part)]
    return np.unique(np.vstack(known), axis=0) if known else np.zeros((0, 3), dtype=np.int32)


def _points(supports: tuple[Any, ...]) -> NDArray[Any]:
    """Of supports without facets."""
    single = [support.points for support in supports if not len(support.facets)]
    return np.concatenate(single) if single else np.zeros(0, dtype=np.int32)
