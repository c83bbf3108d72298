"""A case as a folder that any simulator can read: case.json, rest.vtu and rest.npz.

`rest.vtu` and `rest.npz` hold the same arrays, all in the rest numbering and SI units; `rest.npz`
has some more. case.json says what each of them is, and what the equations are, in the words of
`conventions.toml`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.boundary_conditions import Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.fingerprint import array_hash
from palpate.meshes.material_law import Law
from palpate.meshes.own_files import own_path, write_own_text
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.meshes.rigid_tool import RigidTool, SurfaceShape
from palpate.validation.exchange.nodal_arrays import nodal_force, rest_arrays, sliding_points


@cache
def _texts() -> dict[str, Any]:
    file = resources.files("palpate.validation.exchange") / "conventions.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def describe_conventions(strain: Strain, law: Law = Law.SAINT_VENANT_KIRCHHOFF) -> dict[str, Any]:
    """What all cases with a strain measure and law have in common: keys of case.json and texts.

    Law, arrays (of each its files, shape, unit and meaning), the equations by topic, all the
    document's keys, and what to send back.
    """
    texts = _texts()
    own = texts[strain]
    topics = texts["conventions"] | {"internal_force": own["internal_force"]}
    if strain is Strain.GREEN and not law.is_linear_in_strain:
        own = {"law": texts["laws"][law]["energy"]}
        topics["internal_force"] = texts["laws"]["internal_force"].replace(
            "{stress}", texts["laws"][law]["stress"]
        )
        del topics["smoothed_element"]
    topics["pressure"] = topics["pressure"].replace("{pressure}", texts[strain]["pressure"])
    return {
        "law": own["law"],
        "arrays": texts["arrays"],
        "conventions": topics,
        "keys": texts["keys"],
        "result": texts["result"],
    }


SCHEMA = 1
FILES = ("case.json", "rest.vtu", "rest.npz")
_BY_POINT = ("fixed", "prescribed_displacement", "external_force", "lumped_mass")
_OF_SUPPORTS = ("components", "displacement", "amplitude", "rotation", "normal")
_BY_CELL = ("youngs_modulus", "poissons_ratio", "density", "c01")


def case_key(problem: Problem, strain: Strain) -> str:
    """SHA-256 over everything the result depends on."""
    return array_hash(f"palpate exchange {SCHEMA} {strain}", problem_arrays(problem))


def write_case_folder(
    folder: str | Path, problem: Problem, strain: Strain, *, name: str, title: str = ""
) -> None:
    """Write a case for other simulators; the folder is made if it is not there.

    Args:
        folder: The folder to write to; files of the same names are replaced.
        problem: The problem, in SI units.
        strain: Which of the two laws is asked for.
        name: The case's name.
        title: One line for people.

    Raises:
        InputError: `folder` is a file, or a tool has a shape that only palpate can read.
    """
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InputError(f"{folder}: is a file; name a folder for the case")
    is_new = not target.exists()
    target.mkdir(parents=True, exist_ok=True)
    try:
        with _alone(target):
            # Without it, nobody takes a folder for a case that is half of this one.
            (target / "case.json").unlink(missing_ok=True)
            _write_files(target, problem, strain, name, title)
    except BaseException:
        if is_new:
            shutil.rmtree(target, ignore_errors=True)
        raise


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let other processes that write to the folder wait; where there are no locks they do not."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _write_files(target: Path, problem: Problem, strain: Strain, name: str, title: str) -> None:
    arrays = rest_arrays(problem)
    by_point = {name: arrays[name] for name in _BY_POINT}
    by_cell = {name: arrays[name] for name in _BY_CELL if name in arrays}
    write_mesh(target / "rest.vtu", problem.mesh, point_data=by_point, cell_data=by_cell)
    arrays |= _follower_pressures(problem)
    arrays["support"] = _fixing_supports(problem)
    arrays |= _sliding_points(problem)
    if problem.initial_velocity is not None:
        arrays["initial_velocity"] = problem.initial_velocity.at(problem.mesh.points)
    for index, load in enumerate(problem.loads):
        if load.amplitude is not None and not isinstance(load, Pressure):
            arrays[f"external_force_{index}"] = nodal_force(problem.mesh, load)
    with own_path(target / "rest.npz") as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    description = _describe(problem, strain, name, title)
    text = json.dumps(description, indent=2, allow_nan=False)
    write_own_text(target / "case.json", text + "\n")


def _describe(problem: Problem, strain: Strain, name: str, title: str) -> dict[str, Any]:
    span = problem.time
    time = None
    if span is not None:
        outputs = span.output_times
        time = {**dataclasses.asdict(span), "output_times": outputs.tolist()}
        time["starts"] = "at rest" if problem.initial_velocity is None else "at initial_velocity"
    return {
        "palpate_case": SCHEMA,
        "name": name,
        "title": title,
        "case_key": case_key(problem, strain),
        "strain": strain.value,
        "units": {"length": "m", "force": "N", "stress": "Pa", "density": "kg/m3", "time": "s"},
        "material": dataclasses.asdict(problem.material),
        "has_inclusions": bool(problem.inclusions),
        "num_points": problem.mesh.num_points,
        "num_cells": problem.mesh.num_cells,
        "time": time,
        "loads": [
            {"kind": type(load).__name__, "amplitude": _plain(load.amplitude)}
            for load in problem.loads
        ],
        "supports": [
            {key: _plain(getattr(support, key)) for key in _OF_SUPPORTS}
            for support in problem.supports
        ],
        "tools": [_describe_tool(tool) for tool in problem.tools],
        "springs": [_plain(spring) for spring in problem.springs],
        "masses": [_plain(mass) for mass in problem.masses],
        **describe_conventions(strain, problem.material.law),
    }


def _describe_tool(tool: RigidTool) -> dict[str, Any]:
    if isinstance(tool.shape, SurfaceShape):
        raise InputError("a tool given by a surface cannot be given to other simulators yet")
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
    loads = [(k, load) for k, load in enumerate(problem.loads) if isinstance(load, Pressure)]
    counts = [len(load.facets) for _, load in loads]
    facets = [load.facets for _, load in loads]
    return {
        "pressure_facets": np.vstack([np.zeros((0, 3), dtype=np.int32), *facets]),
        "pressure": np.repeat([float(load.pressure) for _, load in loads], counts),
        "pressure_load": np.repeat(np.array([k for k, _ in loads], dtype=np.int32), counts),
    }


def _fixing_supports(problem: Problem) -> NDArray[np.int32]:
    """Number of the support that fixes a component, -1 where free, (num_points, 3)."""
    numbers = np.full(problem.mesh.points.shape, -1, dtype=np.int32)
    for number, support in enumerate(problem.supports):
        for axis in np.flatnonzero(support.components) if support.normal is None else ():
            numbers[support.points, axis] = number
    return numbers


def _sliding_points(problem: Problem) -> dict[str, NDArray[Any]]:
    """Directions along which points slide on slanted planes; nothing where none does."""
    slopes = sliding_points(problem)
    if slopes is None:
        return {}
    directions, values = slopes.directions()
    normals, shifts = np.zeros((problem.mesh.num_points, 6)), np.zeros((problem.mesh.num_points, 2))
    normals[slopes.points], shifts[slopes.points] = directions.reshape(-1, 6), values
    # All that move a sliding point have one amplitude.
    numbers = np.full(problem.mesh.num_points, -1, dtype=np.int32)
    for number, support in enumerate(problem.supports):
        if support.is_moved:
            numbers[np.intersect1d(support.points, slopes.points)] = number
    return {"sliding_normals": normals, "sliding_displacement": shifts, "sliding_support": numbers}
