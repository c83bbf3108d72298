"""A Problem as one .npz file, exact and without pickle, to pass it to another process."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.errors import FileFormatError
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Inclusion, InitialVelocity, Material, Problem, TimeSpan
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
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.temporaries import atomic_path
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.meshes.untrusted import parse_json, read_npz

# Fields that are written as tables of plain values.
_PLAIN = ("material", "time", "initial_velocity")
# The classes that a problem is made of, with the fields that are always written. Later fields are
# left out at their default, so that the arrays of a problem that does not use them, and with them
# its hash, stay the same.
_FIRST_FIELDS: dict[type[Any], str] = {
    Problem: "supports loads material time",
    Material: "youngs_modulus poissons_ratio density",
    TimeSpan: "end_time time_step mass_damping num_outputs",
    Support: "points facets components displacement amplitude",
    Traction: "facets traction amplitude",
    Pressure: "facets pressure amplitude",
    PointForce: "points forces amplitude",
    BodyForce: "force_density amplitude",
    TabularAmplitude: "times factors is_smooth",
    RigidTool: "shape path friction_coefficient contact_facets drive",
    SphereShape: "radius",
    CapsuleShape: "radius half_length",
    BoxShape: "half_widths",
    PlaneShape: "",
    SurfaceShape: "surface",
    TriSurface: "points facets",
    ToolPath: "times positions rotations",
    ForceDrive: "direction force amplitude mass",
    Inclusion: "cells material",
    InitialVelocity: "velocity angular_velocity center",
    Rotation: "axis center angle",
    Spring: "facets center radius stiffness path",
    AnchorPath: "times displacements is_smooth",
    PointMass: "facets mass",
}
_KINDS = {kind.__name__: kind for kind in _FIRST_FIELDS}


def problem_arrays(problem: Problem) -> dict[str, NDArray[Any]]:
    """The problem as named arrays; plain values are JSON text in `header`.

    The same problem always gives the same arrays, so they also serve as its identity. A field that
    was added later is included only where it differs from its default.
    """
    arrays: dict[str, NDArray[Any]] = {
        "points": problem.mesh.points,
        "cells": problem.mesh.cells,
    }
    for name, rows in problem.mesh.facet_groups.items():
        arrays[f"facet_group:{name}"] = rows
    for name, rows in problem.mesh.point_groups.items():
        arrays[f"point_group:{name}"] = rows
    header: dict[str, Any] = {"schema": 1}
    for name, value in _written_fields(problem):
        if name in _PLAIN:
            header[name] = dict(_written_fields(value)) if value else None
        elif isinstance(value, tuple):
            header[name] = [
                _encoded(item, f"{name}:{index}", arrays) for index, item in enumerate(value)
            ]
        elif name != "mesh":
            header[name] = value
    arrays["header"] = np.array(json.dumps(header, sort_keys=True))
    return arrays


def _written_fields(item: Any) -> Iterator[tuple[str, Any]]:
    first = _FIRST_FIELDS[_KINDS[type(item).__name__]].split()
    for part in dataclasses.fields(item):
        value = getattr(item, part.name)
        if part.name in first or not _is_default(part, value):
            yield part.name, value


def _is_default(part: dataclasses.Field[Any], value: Any) -> bool:
    default = part.default
    if part.default_factory is not dataclasses.MISSING:
        default = part.default_factory()
    if isinstance(value, np.ndarray):
        return isinstance(default, np.ndarray) and np.array_equal(value, default)
    return default is not dataclasses.MISSING and bool(value == default)


def _encoded(item: Any, prefix: str, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """A dataclass as JSON values; its arrays go to `arrays`, named from `place`; no None."""
    entry: dict[str, Any] = {"kind": type(item).__name__}
    for name, value in _written_fields(item):
        if isinstance(value, np.ndarray):
            arrays[f"{prefix}:{name}"] = value
        elif dataclasses.is_dataclass(value):
            entry[name] = _encoded(value, f"{prefix}:{name}", arrays)
        elif value is not None:
            entry[name] = value
    return entry


def _decoded(entry: dict[str, Any], prefix: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """The dataclass that `_encoded` has turned into JSON values and arrays."""
    values: dict[str, Any] = {}
    for key, value in entry.items():
        if isinstance(value, dict):
            values[key] = _decoded(value, f"{prefix}:{key}", arrays)
        elif key != "kind":
            values[key] = tuple(value) if isinstance(value, list) else value
    for key, rows in _group(arrays, f"{prefix}:").items():
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
        arrays = read_npz(path)
        header = parse_json(str(arrays["header"]))
        if header["schema"] != 1:
            raise FileFormatError(path, f"schema {header['schema']} is not known here (1 is)")
        mesh = TetMesh(
            arrays["points"],
            arrays["cells"],
            _group(arrays, "facet_group:"),
            _group(arrays, "point_group:"),
        )
        values = {name: value for name, value in header.items() if name != "schema"}
        values["material"] = Material(**header["material"])
        values["time"] = TimeSpan(**header["time"]) if header["time"] else None
        if "initial_velocity" in values:
            given = values["initial_velocity"]
            triples = {name: tuple(numbers) for name, numbers in given.items()}
            values["initial_velocity"] = InitialVelocity(**triples)
        for name, entries in values.items():
            if isinstance(entries, list):
                values[name] = tuple(
                    _decoded(entry, f"{name}:{index}", arrays)
                    for index, entry in enumerate(entries)
                )
        return Problem(mesh, **values)
    except FileFormatError:
        raise
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise FileFormatError(path, f"not a problem file ({error})") from error


def _group(arrays: dict[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
