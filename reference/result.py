"""What a reference solve returns, and the file it travels in; importable without FEniCSx."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Strain

Vector: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class ToolHistory:
    """What one tool felt at the knots of the paths, in their order.

    Attributes:
        times: Knots [s].
        forces: On the tool [N].
        moments: On the tool about its origin [N m].
        active_areas: Rest area of the contact points that press on it [m2].
        penetrations: Largest depth of a contact point inside the tool [m], >= 0.
    """

    times: tuple[float, ...]
    forces: tuple[Vector, ...]
    moments: tuple[Vector, ...]
    active_areas: tuple[float, ...]
    penetrations: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ReferenceResult:
    """A converged static state.

    Attributes:
        displacement: At the mesh's points, in their order [m], shape (num_points, 3); of a
            quadratic solve, its values there.
        strain: Strain measure of the model.
        degree: Polynomial degree of the displacement.
        load_factor: Fraction of the load reached: 1.
        converged: True; a solve that is not raises ReferenceNotConvergedError.
        relative_residual: Norm of the out-of-balance nodal forces over that of the external or
            internal ones, whichever is larger [-].
        smallest_det_f: Smallest det F: over the cells (degree 1), over sample points with the
            vertices among them (degree 2 and up) [-]. Positive for Green strain.
        volume: Integral of det F [m3].
        surface_area: Integral of |cof(F) N| over the boundary [m2].
        rest_volume: [m3].
        rest_surface_area: [m2].
        strain_energy: [J].
        newton_iterations: Linear solves in all.
        load_steps: Load factors at which equilibrium was found, the last one 1.
        versions: Of Python and the parts of FEniCSx.
        tools: What each tool felt, in the problem's order.
    """

    displacement: Points
    strain: Strain
    degree: int
    load_factor: float
    converged: bool
    relative_residual: float
    smallest_det_f: float
    volume: float
    surface_area: float
    rest_volume: float
    rest_surface_area: float
    strain_energy: float
    newton_iterations: int
    load_steps: tuple[float, ...] = (1.0,)
    versions: dict[str, str] = field(default_factory=dict)
    tools: tuple[ToolHistory, ...] = ()


def save_result(path: str | Path, result: ReferenceResult) -> None:
    """Write a result to `path` (.npz), whole or not at all."""
    values = {f.name: getattr(result, f.name) for f in dataclasses.fields(result)}
    displacement = values.pop("displacement")
    values["tools"] = [dataclasses.asdict(tool) for tool in result.tools]
    header = np.array(json.dumps(values, sort_keys=True))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, displacement=displacement, header=header)


def _history(rows: dict[str, Any]) -> ToolHistory:
    """Undo what JSON does to tuples."""
    for name in ("forces", "moments"):
        rows[name] = [tuple(row) for row in rows[name]]
    return ToolHistory(**{name: tuple(row) for name, row in rows.items()})


def load_result(path: str | Path) -> ReferenceResult:
    """Read a result written by `save_result`.

    Raises:
        FileFormatError: Missing, damaged, or another kind of file.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            values = json.loads(str(stored["header"]))
            displacement = stored["displacement"]
        values["strain"] = Strain(values["strain"])
        values["load_steps"] = tuple(values["load_steps"])
        values["tools"] = tuple(_history(rows) for rows in values.get("tools", ()))
        return ReferenceResult(displacement=displacement, **values)
    except (OSError, KeyError, ValueError, TypeError, EOFError) as error:
        raise FileFormatError(path, f"not a result of the reference ({error})") from error
