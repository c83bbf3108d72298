"""A Problem as one .npz file: exact, no pickle; the way to hand it to another process."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

_KINDS: dict[str, type[Any]] = {
    kind.__name__: kind
    for kind in (
        Support,
        Traction,
        Pressure,
        PointForce,
        BodyForce,
        TabularAmplitude,
        RigidTool,
        SphereShape,
        CapsuleShape,
        BoxShape,
        PlaneShape,
        SurfaceShape,
        TriSurface,
        ToolPath,
        ForceDrive,
        Inclusion,
        Material,
    )
}
# Problems without tools or inclusions are written as before there were any: same arrays, same key.
_LATER_GROUPS = ("tools", "inclusions")


def problem_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """The problem as named arrays; plain values are kept as JSON text in `header`.

    The same problem always gives the same arrays, so they also serve as its identity.
    """
    arrays: dict[str, NDArray[Any]] = {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
    }
    for name, rows in problem.mesh.facet_groups.items():
        arrays[f"facet_group:{name}"] = rows
    for name, rows in problem.mesh.point_groups.items():
        arrays[f"point_group:{name}"] = rows
    header: dict[str, Any] = {
        "schema": 1,
        "material": dataclasses.asdict(problem.material),
        "time": dataclasses.asdict(problem.time) if problem.time else None,
    }
    for group in ("supports", "loads", *_LATER_GROUPS):
        items = getattr(problem, group)
        if items or group not in _LATER_GROUPS:
            header[group] = [
                _encoded(item, f"{group}:{index}", arrays) for index, item in enumerate(items)
            ]
    arrays["header"] = np.array(json.dumps(header, sort_keys=True))
    return arrays


def _encoded(item: Any, place: str, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """A dataclass as JSON values; its arrays go to `arrays` under their place. None is left out."""
    entry: dict[str, Any] = {"kind": type(item).__name__}
    for part in dataclasses.fields(item):
        value = getattr(item, part.name)
        if isinstance(value, np.ndarray):
            arrays[f"{place}:{part.name}"] = value
        elif dataclasses.is_dataclass(value):
            entry[part.name] = _encoded(value, f"{place}:{part.name}", arrays)
        elif value is not None:
            entry[part.name] = value
    return entry


def _decoded(entry: dict[str, Any], place: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """What `_encoded` was given."""
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if isinstance(value, dict):
            values[key] = _decoded(value, f"{place}:{key}", arrays)
        elif key != "kind":
            values[key] = tuple(value) if isinstance(value, list) else value
    for key, rows in _group(arrays, f"{place}:").items():
        if ":" not in key:
            values[key] = rows
    return _KINDS[entry["kind"]](**values)


def save_problem(path: str | Path, problem: Problem) -> None:
    """Write a problem to `path` (.npz), whole or not at all."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **problem_arrays(problem))


def load_problem(path: str | Path) -> Problem:
    """Read a problem written by `save_problem`.

    Raises:
        FileFormatError: Missing, damaged, or of another schema.
    """
    try:
        # Our own stream: numpy leaves a damaged file open.
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        header = json.loads(str(arrays["header"]))
        if header["schema"] != 1:
            raise FileFormatError(path, f"schema {header['schema']} is not known here (1 is)")
        groups: dict[str, tuple[Any, ...]] = {
            group: tuple(
                _decoded(entry, f"{group}:{index}", arrays)
                for index, entry in enumerate(header.get(group, []))
            )
            for group in ("supports", "loads", *_LATER_GROUPS)
        }
        mesh = TetMesh(
            arrays["points"],
            arrays["cells"],
            _group(arrays, "facet_group:"),
            _group(arrays, "point_group:"),
        )
        return Problem(
            mesh,
            Material(**header["material"]),
            groups["supports"],
            groups["loads"],
            TimeSpan(**header["time"]) if header["time"] else None,
            groups["tools"],
            groups["inclusions"],
        )
    except FileFormatError:
        raise
    except (OSError, KeyError, ValueError, TypeError, EOFError, BadZipFile) as error:
        raise FileFormatError(path, f"not a problem file ({error})") from error


def _group(arrays: dict[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
