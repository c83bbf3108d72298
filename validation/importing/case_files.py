"""A model of another simulator as a case: a .toml file, and its mesh with groups beside it."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.writing import FIRST_CHECKS, case_text
from palpate.validation.importing.acting import Acting, Places, acting_tables
from palpate.validation.importing.model import MIDDLES, Body, ImportRefusedError, Model, ModelUnits

# Middle nodes farther from their edge's middle, of its length, make a curved edge.
_STRAIGHT = 1e-6
_MOST_SHOWN = 30


@dataclass(frozen=True, eq=False)
class Imported:
    """A case in words, its mesh in the model's units, and what a reader has to know."""

    text: str
    mesh: TetMesh
    told: tuple[str, ...]
    ignored: tuple[str, ...]

    def write(self, target: Path) -> None:
        """Write CASE.toml and CASE.msh beside it; neither where one cannot be written."""
        mesh_file = target.with_suffix(".msh")
        with atomic_path(target) as temporary:
            temporary.write_text(self.text, encoding="utf-8")
            write_mesh(mesh_file, self.mesh, groups=True)


def as_case(model: Model, units: ModelUnits, target: Path) -> Imported:
    """Turn a model into a case.

    Raises:
        ImportRefusedError: What a case cannot say; with the line.
        InputError: A mesh or a material that cannot be used.
    """
    _require_usable(model)
    used = np.unique(model.corners)
    point_of = np.full(len(model.nodes), -1, dtype=np.int64)
    point_of[used] = np.arange(len(used))
    groups, material, inclusions = _materials(model, units)
    mesh = TetMesh(model.nodes[used], point_of[model.corners].astype(np.int32))
    places = Places(model, mesh, point_of)

    def accelerate(density: Any) -> list[float]:
        """From a force by volume in the model's units [m/s2]."""
        of_body = material.get("density", 1000.0)
        factor = units.kilograms_per_cubic_metre(1.0)
        return [units.metres_per_second_squared(float(f) * factor / of_body) for f in density]

    acting = acting_tables(places, accelerate, groups)
    if model.acceleration is not None:
        shown = [units.metres_per_second_squared(a) for a in model.acceleration]
        acting.loads.append({"kind": "gravity", "acceleration": shown})
    if model.body_force is not None:
        acting.loads.append({"kind": "gravity", "acceleration": accelerate(model.body_force)})
    _require_one_density(model, acting)
    told = [*model.told, *_about_middles(model), *_about_density(model, acting), *acting.told]
    values = {
        "schema": 1,
        "title": model.title or f"{model.path.stem}, imported from {model.program}",
        "strain": str(model.strain),
        "units": units.table,
        "geometry": {"mesh": target.with_suffix(".msh").name},
        "material": material,
        "inclusion": inclusions,
        "support": acting.supports,
        "load": acting.loads,
        "check": [
            c for c in FIRST_CHECKS if c["against"] != "truth" or not acting.has_point_forces
        ],
    }
    grouped = TetMesh(mesh.points, mesh.cells, acting.facets, acting.points, groups)
    text = _head(model, told) + case_text(values)
    return Imported(text, grouped, tuple(told), tuple(model.ignored))


def _require_usable(model: Model) -> None:
    if not len(model.corners):
        raise ImportRefusedError(model.path, None, "holds no tetrahedra")
    if not np.isfinite(model.nodes).all():
        raise ImportRefusedError(model.path, None, "a coordinate is NaN or infinite")


def _materials(
    model: Model, units: ModelUnits
) -> tuple[dict[str, NDArray[np.int32]], dict[str, Any], list[dict[str, Any]]]:
    """Groups of cells, the table [material] of the largest part, and the [[inclusion]] tables."""
    counts = np.bincount(model.body_of, minlength=len(model.bodies))
    main = int(np.argmax(counts))
    groups: dict[str, NDArray[np.int32]] = {}
    inclusions = []
    for number in np.flatnonzero(counts).tolist():
        if number == main:
            continue
        name = f"part-{number + 1}"
        groups[name] = np.flatnonzero(model.body_of == number).astype(np.int32)
        inclusions.append(
            {"region": {"group": name}, "material": _material(model.bodies[number], units)}
        )
    laws = {body.constants.get("law") for k, body in enumerate(model.bodies) if counts[k]}
    if len(laws) > 1:
        raise model.bodies[main].place.refuse(
            f"a body of several laws ({', '.join(sorted(map(str, laws)))}); a case has one"
        )
    return groups, _material(model.bodies[main], units), inclusions


def _material(body: Body, units: ModelUnits) -> dict[str, Any]:
    table = dict(body.constants)
    if body.density is not None:
        table["density"] = units.kilograms_per_cubic_metre(body.density)
    return table


def _require_one_density(model: Model, acting: Acting) -> None:
    used = [model.bodies[k] for k in np.unique(model.body_of)]
    has_weight = any(load["kind"] == "gravity" for load in acting.loads)
    if has_weight and len({body.density for body in used}) > 1:
        raise used[1].place.refuse(
            "gravity on parts of different density; a case weighs the whole body by its own "
            "material's density"
        )


def _about_density(model: Model, acting: Acting) -> list[str]:
    has_weight = any(load["kind"] == "gravity" for load in acting.loads)
    without = [body for k in np.unique(model.body_of) if (body := model.bodies[k]).density is None]
    if not without:
        return []
    if has_weight and model.acceleration is not None:
        raise without[0].place.refuse("gravity acts, and this material has no density; give one")
    return ["no density in the file: 1000 kg/m3 stands in the case, on which no force depends"]


def _about_middles(model: Model) -> list[str]:
    quadratic = (model.middles >= 0).all(axis=1)
    if not quadratic.any():
        return []
    ends = model.nodes[model.corners[quadratic][:, MIDDLES]]
    straight, edges = ends.mean(axis=2), np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    off = np.linalg.norm(model.nodes[model.middles[quadratic]] - straight, axis=2) / edges
    told = [
        f"{int(quadratic.sum())} quadratic tetrahedra are read by their corners: how cells are "
        "interpolated is the simulator's affair, not the case's"
    ]
    if off.max() > _STRAIGHT:
        told.append(
            f"{int((off > _STRAIGHT).sum())} of their edges are curved, by up to {off.max():.2g} "
            "of their length: the case's body has straight ones"
        )
    return told


def _head(model: Model, told: list[str]) -> str:
    lines = [f"Imported from {model.path.name} ({model.program})."]
    lines += [f"- {line}" for line in told]
    if model.ignored:
        shown = [*model.ignored[:_MOST_SHOWN], *["..."] * (len(model.ignored) > _MOST_SHOWN)]
        lines.append(f"- left out, for no mechanics depend on it: {'; '.join(shown)}")
    wrapped = [part for line in lines for part in textwrap.wrap(line, 96, subsequent_indent="  ")]
    printable = ["".join(c if c.isprintable() else "?" for c in line) for line in wrapped]
    return "".join(f"# {line}\n" for line in printable)


def require_toml(target: Path) -> None:
    """Raise InputError where a case file has another ending."""
    if target.suffix != ".toml":
        raise InputError(f"{target}: a case file needs the ending .toml")
