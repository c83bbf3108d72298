"""A case as a folder that any simulator can read: case.json, rest.vtu and rest.npz.

`rest.vtu` and `rest.npz` hold the same arrays, all in the rest numbering and SI units:

    points, cells            the tetrahedra
    fixed                    1 where a component of a point is held, (num_points, 3)
    prescribed_displacement  where it is held [m], (num_points, 3)
    external_force           dead loads at their full size, at the points [N], (num_points, 3)
    lumped_mass              [kg], (num_points,)
    youngs_modulus, poissons_ratio, density    by cell [Pa], [-], [kg/m3]

`rest.npz` alone also holds `pressure_facets` (n, 3) and `pressure` (n,) [Pa], which follow the
surface, and `external_force_K` for each load K that has an amplitude of its own.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.atomic_write import atomic_path, write_text_atomically
from palpate.meshes.boundary_conditions import Load, Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.meshes.rigid_tool import RigidTool, SurfaceShape
from palpate.validation.exchange.nodal_loads import (
    cell_materials,
    held_components,
    lumped_mass,
    nodal_force,
)

SCHEMA = 1
FILES = ("case.json", "rest.vtu", "rest.npz")
_LAWS = {
    Strain.GREEN: "Saint-Venant-Kirchhoff: S = lmbda tr(E) I + 2 mu E, E = (F^T F - I) / 2",
    Strain.LINEAR: "linear elasticity: sigma = lmbda tr(e) I + 2 mu e, e = sym(grad u)",
}
_ANSWER = (
    "write one file: .npz, .vtu or .csv with `displacement` [m], (num_points, 3), in the order of "
    "the points here; or with `original_id` in another order; or .vtu with tetrahedra of its own. "
    "`positions` instead of `displacement` if you have those. Dynamic cases: .npz with "
    "`displacement` (num_times, num_points, 3) and `times`. Optional text in .npz: `length_unit` "
    "(m, cm, mm), `case_key`, `about` (JSON: tool, version, law)."
)


def case_key(problem: Problem, strain: Strain) -> str:
    """SHA-256 over everything the answer depends on."""
    digest = hashlib.sha256(f"palpate exchange {SCHEMA} {strain}".encode())
    for name, array in sorted(problem_arrays(problem).items()):
        digest.update(f"|{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def is_case_folder(folder: Path) -> bool:
    """Whether a folder's case.json is one that `write_case_folder` wrote."""
    try:
        document = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(document, dict) and "palpate_case" in document


def write_case_folder(
    folder: str | Path, problem: Problem, strain: Strain, *, name: str, title: str = ""
) -> None:
    """Write a case for other simulators; the folder is made if it is not there.

    Args:
        folder: Where; files of the same names are replaced.
        problem: In SI units.
        strain: Which of the two laws is asked for.
        name: The case's name.
        title: One line for people.

    Raises:
        InputError: `folder` is a file, or a tool has a shape that only palpate can read.
    """
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the case")
    target.mkdir(parents=True, exist_ok=True)
    fixed, moved = held_components(problem)
    materials = cell_materials(problem)
    by_point: dict[str, NDArray[Any]] = {
        "fixed": fixed,
        "prescribed_displacement": moved,
        "external_force": sum(
            (nodal_force(problem.mesh, load) for load in problem.loads),
            np.zeros_like(problem.mesh.points),
        ),
        "lumped_mass": lumped_mass(problem),
    }
    by_cell: dict[str, NDArray[Any]] = {
        "youngs_modulus": materials[:, 0],
        "poissons_ratio": materials[:, 1],
        "density": materials[:, 2],
    }
    write_mesh(target / "rest.vtu", problem.mesh, point_data=by_point, cell_data=by_cell)
    arrays: dict[str, Any] = {"points": problem.mesh.points, "cells": problem.mesh.cells}
    arrays |= by_point | by_cell
    arrays |= _follower_pressures(problem)
    for index, load in enumerate(problem.loads):
        if load.amplitude is not None and not isinstance(load, Pressure):
            arrays[f"external_force_{index}"] = nodal_force(problem.mesh, load)
    with atomic_path(target / "rest.npz") as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    description = _describe(problem, strain, name, title)
    text = json.dumps(description, indent=2, allow_nan=False)
    write_text_atomically(target / "case.json", text + "\n")


def _describe(problem: Problem, strain: Strain, name: str, title: str) -> dict[str, Any]:
    span = problem.time
    time = None
    if span is not None:
        outputs = np.linspace(0.0, span.end_time, span.num_outputs + 1)
        time = {**dataclasses.asdict(span), "output_times": outputs.tolist(), "starts": "at rest"}
    return {
        "palpate_case": SCHEMA,
        "name": name,
        "title": title,
        "case_key": case_key(problem, strain),
        "strain": strain.value,
        "law": _LAWS[strain],
        "units": {"length": "m", "force": "N", "stress": "Pa", "density": "kg/m3", "time": "s"},
        "material": dataclasses.asdict(problem.material),
        "has_inclusions": bool(problem.inclusions),
        "num_points": problem.mesh.num_points,
        "num_cells": problem.mesh.num_cells,
        "time": time,
        "loads": [_describe_load(load) for load in problem.loads],
        "tools": [_describe_tool(tool) for tool in problem.tools],
        "arrays": "rest.vtu, and the same in rest.npz",
        "answer": _ANSWER,
    }


def _describe_load(load: Load) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": type(load).__name__, "amplitude": None}
    if load.amplitude is not None:
        entry["amplitude"] = _plain(load.amplitude)
    return entry


def _describe_tool(tool: RigidTool) -> dict[str, Any]:
    if isinstance(tool.shape, SurfaceShape):
        raise InputError("a tool given by a surface cannot be handed to other simulators yet")
    described: dict[str, Any] = _plain(tool)
    described["shape"] = {"kind": type(tool.shape).__name__, **_plain(tool.shape)}
    return described


def _plain(item: Any) -> Any:
    """Arrays as lists and data classes as tables, for JSON."""
    if isinstance(item, np.ndarray):
        return item.tolist()
    if dataclasses.is_dataclass(item):
        return {f.name: _plain(getattr(item, f.name)) for f in dataclasses.fields(item)}
    if isinstance(item, tuple | list):
        return [_plain(x) for x in item]
    return item


def _follower_pressures(problem: Problem) -> dict[str, NDArray[Any]]:
    pressures = [load for load in problem.loads if isinstance(load, Pressure)]
    facets = [load.facets for load in pressures] or [np.zeros((0, 3), dtype=np.int32)]
    sizes = [np.full(len(load.facets), load.pressure) for load in pressures] or [np.zeros(0)]
    return {"pressure_facets": np.vstack(facets), "pressure": np.concatenate(sizes)}
