"""A model of another simulator as a case: a .toml file, and its mesh with groups beside it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.files import write_mesh
from palpate.meshes.temporaries import atomic_path
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.case.writing import FIRST_CHECKS, case_text
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.importing.model import (
    MIDDLES,
    Body,
    Face,
    FixedNodes,
    ImportRefusedError,
    Model,
    Source,
    UnitSystem,
)
from palpate.validation.importing.nodal_forces import fit_body_force, fit_tractions

# Tables of loads that differ from point to point; a file with more is no longer read by people.
MOST_TABLES = 500
# Middle nodes farther from their edge's middle, of its length, make a curved edge.
_STRAIGHT = 1e-6
_MOST_SHOWN = 30


@dataclass(frozen=True, eq=False)
class Imported:
    """A case in words, its mesh in the model's units, and what a reader has to know."""

    text: str
    mesh: TetMesh
    notes: tuple[str, ...]
    ignored: tuple[str, ...]

    def write(self, target: Path) -> None:
        """Write CASE.toml and CASE.msh beside it; neither where one cannot be written."""
        mesh_file = target.with_suffix(".msh")
        with atomic_path(target) as temporary:
            temporary.write_text(self.text, encoding="utf-8")
            write_mesh(mesh_file, self.mesh, groups=True)


def as_case(model: Model, units: UnitSystem, target: Path) -> Imported:
    """Turn a model into a case.

    Raises:
        ImportRefusedError: What a case cannot say; with the line.
        InputError: A mesh or a material that cannot be used.
    """
    if not len(model.corners):
        raise ImportRefusedError(model.path, None, "holds no tetrahedra")
    if not np.isfinite(model.nodes).all():
        raise ImportRefusedError(model.path, None, "a coordinate is NaN or infinite")
    groups, material, inclusions = _materials(model, units)
    # From a force by volume in the model's units to an acceleration [m/s2].
    density = units.kilograms_per_cubic_metre(1.0) / material.get("density", 1000.0)
    scale = units.metres_per_second_squared(density)
    tables = _Tables(model, groups, scale)
    tables.add_supports()
    for face in model.faces:
        tables.add_face_load(face)
    tables.add_nodal_forces()
    if model.acceleration is not None:
        tables.add_weight(model.acceleration, units.metres_per_second_squared(1.0))
    if model.body_force is not None:
        tables.add_weight(model.body_force, scale)
    notes = [
        *model.notes,
        *_about_middles(model),
        *_about_density(model, tables.loads),
        *tables.notes,
    ]
    values = {
        "schema": 1,
        "title": model.title or f"{model.path.stem}, imported from {model.program}",
        "strain": str(model.strain),
        "units": units.table,
        "geometry": {"mesh": target.with_suffix(".msh").name},
        "material": material,
        "inclusion": inclusions,
        "support": tables.supports,
        "load": tables.loads,
        "check": [
            c for c in FIRST_CHECKS if c["against"] != "truth" or not tables.has_point_forces
        ],
    }
    mesh = TetMesh(tables.mesh.points, tables.mesh.cells, tables.facets, tables.points, groups)
    return Imported(
        _head(model, notes) + case_text(values), mesh, tuple(notes), tuple(model.ignored)
    )


class _Tables:
    """Supports and loads of a model as tables of a case, with the groups of its mesh they name.

    Args:
        model: The model in its own units of length, like the mesh.
        taken: Names of other groups of the mesh.
        acceleration: Acceleration of a unit of force by volume [m/s2].
    """

    def __init__(self, model: Model, taken: Iterable[str], acceleration: float) -> None:
        self.model, self.taken, self.acceleration = model, set(taken), acceleration
        self.supports: list[dict[str, Any]] = []
        self.loads: list[dict[str, Any]] = []
        self.facets: dict[str, Indices] = {}
        self.points: dict[str, Indices] = {}
        self.notes: list[str] = []
        self.has_point_forces = False
        # Nodes as points of the case's mesh; -1 where a node is none.
        self.node_of = np.unique(model.corners)
        self.point_of = np.full(len(model.nodes), -1, dtype=np.int64)
        self.point_of[self.node_of] = np.arange(len(self.node_of))
        cells = self.point_of[model.corners].astype(np.int32)
        self.mesh = TetMesh(model.nodes[self.node_of], cells)
        self.row_of = {tuple(row): k for k, row in enumerate(_sorted(self.mesh.boundary_facets))}
        quadratic = model.is_quadratic
        ends = model.corners[quadratic][:, MIDDLES].reshape(-1, 2).tolist()
        middles = model.middles[quadratic].ravel().tolist()
        # The ends of each middle node's edge, and the middle node of each edge.
        self.ends = dict(zip(middles, map(tuple, ends), strict=True))
        self.middle_of = {tuple(sorted(pair)): node for node, pair in self.ends.items()}

    def _name(self, wanted: str) -> str:
        """A name for a group that no other has, in the letters that a mesh file allows."""
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "-", wanted).strip("-")[:48] or "group"
        names = (plain if k == 1 else f"{plain}-{k}" for k in range(1, len(self.taken) + 2))
        name = next(name for name in names if name not in self.taken)
        self.taken.add(name)
        return name

    def add_weight(self, vector: Iterable[float], scale: float) -> None:
        """Gravity: an acceleration or a force by volume, times what makes it one in m/s2."""
        acceleration = [float(component) * scale for component in vector]
        self.loads.append({"kind": "gravity", "acceleration": acceleration})

    def add_supports(self) -> None:
        """What the model fixes and moves.

        Raises:
            ImportRefusedError: What contradicts, or middle nodes that are fixed without the ends.
        """
        wanted: dict[tuple[int, int], tuple[float, FixedNodes]] = {}
        found: list[tuple[FixedNodes, Indices]] = []
        for support in self.model.supports:
            points = self._points_of(support)
            for point in points.tolist():
                for axis, value in support.components.items():
                    other, by = wanted.setdefault((point, axis), (value, support))
                    if other != value:
                        raise support.source.refuse(
                            f"{support.name} moves a node along {'xyz'[axis]} by {value:g} that "
                            f"{by.name} (line {by.source.line}) moves by {other:g}; fix it once"
                        )
            if len(points):
                found.append((support, points))
        if len(found) > MOST_TABLES:
            raise found[MOST_TABLES][0].source.refuse(
                f"displacements are prescribed in {len(found)} different ways, more than the "
                f"{MOST_TABLES} tables a case is given here; a turn or a uniform displacement of a "
                "whole face can be said in one [[support]] by hand"
            )
        boundary = self.mesh.boundary_facets
        for support, points in found:
            table: dict[str, Any] = {}
            if len(support.components) < 3:
                table["components"] = ["xyz"[axis] for axis in sorted(support.components)]
            if any(support.components.values()):
                table["displacement"] = [support.components.get(axis, 0.0) for axis in range(3)]
            # Facets whose corners are all fixed, and fixed points of none of them.
            facets = boundary[np.isin(boundary, points).all(axis=1)]
            single = np.setdiff1d(points, facets).astype(np.int32)
            names = []
            if len(facets):
                names.append(self._name(support.name))
                self.facets[names[-1]] = facets
            if len(single):
                name = f"{support.name}-points" if len(facets) else support.name
                names.append(self._name(name))
                self.points[names[-1]] = single
            self.supports += [{"region": {"group": name}, **table} for name in names]

    def _points_of(self, support: FixedNodes) -> Indices:
        """Points that stand for fixed nodes."""
        fixed = set(support.nodes.tolist())
        loose = 0
        for node in fixed:
            if self.point_of[node] >= 0:
                continue
            if node not in self.ends:
                loose += 1
            elif not fixed.issuperset(self.ends[node]):
                raise support.source.refuse(
                    f"{support.name} fixes the middle node {self.model.labels[node]} of an edge "
                    "but not both of its ends; a case has corner nodes only: fix whole faces"
                )
        if loose:
            note = f"{support.name}: {loose} fixed node(s) of no element are left out"
            self.model.notes.append(note)
        points: Indices = np.unique(self.point_of[support.nodes]).astype(np.int32)
        chosen: Indices = points[points >= 0]
        return chosen

    def add_face_load(self, face: Face) -> None:
        """A pressure or a traction.

        Raises:
            ImportRefusedError: A facet that is none of the boundary, or twice there.
        """
        facets = self.point_of[face.facets].astype(np.int32)
        rows = [self.row_of.get(tuple(row), -1) for row in _sorted(facets)]
        if -1 in rows:
            guilty = self.model.labels[face.facets[rows.index(-1)]].tolist()
            raise face.source.refuse(
                f"{face.name}: the facet of nodes {guilty} is none of the body's boundary"
            )
        if len(set(rows)) < len(rows):
            raise face.source.refuse(f"{face.name}: a facet is named twice")
        ours = self.mesh.boundary_facets[rows]
        if face.pressure is None:
            # A traction has its own direction, whichever way a facet looks.
            self._push(face.name, ours, {"kind": "traction", "traction": list(face.traction or ())})
            return
        vectors = area_vectors(self.mesh.points, ours), area_vectors(self.mesh.points, facets)
        is_turned = np.sum(vectors[0] * vectors[1], axis=1) < 0.0
        for chosen, sign in ((~is_turned, 1.0), (is_turned, -1.0)):
            if chosen.any():
                table = {"kind": "pressure", "pressure": sign * face.pressure}
                self._push(face.name, ours[chosen], table)

    def _push(self, wanted: str, facets: Indices, table: dict[str, Any]) -> str:
        """A load on facets, and the name of their group."""
        name = self._name(wanted)
        self.facets[name] = facets
        self.loads.append({**table, "region": {"group": name}})
        return name

    def add_nodal_forces(self) -> None:
        """Forces on nodes as a weight, as tractions, or as forces on points.

        Raises:
            ImportRefusedError: A force on a node of no element, or one that no traction explains
                on a middle node, or too many different ones.
        """
        model, forces = self.model, self.model.forces
        if not forces.any():
            return
        unused = (self.point_of < 0) & forces.any(axis=1)
        unused[list(self.ends)] = False
        if unused.any():
            label = int(model.labels[np.argmax(unused)])
            raise self._pushed_at().refuse(f"a force on node {label}, which no element has")
        corners = self.node_of[self.mesh.boundary_facets]
        edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        found = [self.middle_of.get((a, b), -1) for a, b in edges.reshape(-1, 2).tolist()]
        middles = np.array(found, dtype=np.int64).reshape(-1, 3)
        is_inside = np.ones(len(forces), dtype=bool)
        is_inside[corners] = False
        is_inside[middles[middles >= 0]] = False
        weights = _volumes_of_nodes(model)
        density = fit_body_force(weights, is_inside & (weights != 0.0), forces)
        if density is not None:
            forces = forces - weights[:, None] * density
            noise = 1e-9 * np.abs(model.forces).max()
            forces[np.abs(forces).max(axis=1) <= noise] = 0.0
            self.add_weight(density, self.acceleration)
            self.notes.append(
                "forces on inner nodes are those of a uniform weight: read as gravity"
            )
        fitted, left = fit_tractions(model.nodes, corners, middles, forces)
        for number, traction in enumerate(fitted, 1):
            values = traction.values.tolist()
            table: dict[str, Any] = {"kind": "traction"}
            if len(values) == 1:
                table["traction"] = values[0]
            else:
                at = traction.positions.tolist()
                table["values"] = [
                    {"at": a, "traction": t} for a, t in zip(at, values, strict=True)
                ]
            wanted = "nodal-forces" if len(fitted) == 1 else f"nodal-forces-{number}"
            name = self._push(wanted, self.point_of[traction.facets].astype(np.int32), table)
            kind = "a uniform" if len(values) == 1 else "an affine"
            self.notes.append(
                f"forces on nodes are those of {kind} traction on {len(traction.facets)} facets: "
                f"read as one on {name}"
            )
        self._point_forces(left)

    def _pushed_at(self) -> Source:
        return self.model.pushed_at or Source(self.model.path, 1)

    def _point_forces(self, forces: Points) -> None:
        model, loaded = self.model, np.flatnonzero(forces.any(axis=1))
        if not len(loaded):
            return
        middles = loaded[self.point_of[loaded] < 0]
        kinds, which = np.unique(forces[loaded], axis=0, return_inverse=True)
        trouble = ""
        if len(middles):
            trouble = (
                f"node {model.labels[middles[0]]} is a middle node, which a case does not have"
            )
        elif len(kinds) > MOST_TABLES:
            trouble = f"they are {len(kinds)} different ones (at most {MOST_TABLES} here)"
        if trouble:
            raise self._pushed_at().refuse(
                f"forces on {len(loaded)} nodes are those of no uniform or affine traction, and "
                f"{trouble}; give a pressure or a traction on the face instead"
            )
        for number, force in enumerate(kinds):
            name = self._name(f"forces-{number + 1}")
            self.points[name] = self.point_of[loaded[which.ravel() == number]].astype(np.int32)
            self.loads.append(
                {"kind": "point_force", "region": {"group": name}, "force": force.tolist()}
            )
        self.has_point_forces = True
        self.notes.append(
            f"forces on {len(loaded)} node(s) are those of no uniform or affine traction: they "
            "stay forces on points, under which displacements have no limit; no truth is possible, "
            "only checks on the same mesh"
        )


def _materials(
    model: Model, units: UnitSystem
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
        raise model.bodies[main].source.refuse(
            f"a body of several laws ({', '.join(sorted(map(str, laws)))}); a case has one"
        )
    return groups, _material(model.bodies[main], units), inclusions


def _material(body: Body, units: UnitSystem) -> dict[str, Any]:
    table = dict(body.constants)
    if body.density is not None:
        table["density"] = units.kilograms_per_cubic_metre(body.density)
    return table


def _about_density(model: Model, loads: list[dict[str, Any]]) -> list[str]:
    used = [model.bodies[k] for k in np.unique(model.body_of)]
    has_weight = any(load["kind"] == "gravity" for load in loads)
    if has_weight and len({body.density for body in used}) > 1:
        raise used[1].source.refuse(
            "gravity on parts of different density; a case weighs the whole body by its own "
            "material's density"
        )
    without = [body for body in used if body.density is None]
    if not without:
        return []
    if has_weight and model.acceleration is not None:
        raise without[0].source.refuse("gravity acts, and this material has no density; give one")
    return ["no density in the file: 1000 kg/m3 stands in the case, on which no force depends"]


def _about_middles(model: Model) -> list[str]:
    quadratic = model.is_quadratic
    if not quadratic.any():
        return []
    ends = model.nodes[model.corners[quadratic][:, MIDDLES]]
    straight, edges = ends.mean(axis=2), np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    off = np.linalg.norm(model.nodes[model.middles[quadratic]] - straight, axis=2) / edges
    notes = [
        f"{int(quadratic.sum())} quadratic tetrahedra are read by their corners: how cells are "
        "interpolated is the simulator's affair, not the case's"
    ]
    if off.max() > _STRAIGHT:
        notes.append(
            f"{int((off > _STRAIGHT).sum())} of their edges are curved, by up to {off.max():.2g} "
            "of their length: the case's body has straight ones"
        )
    return notes


def _head(model: Model, notes: list[str]) -> str:
    lines = [f"Imported from {model.path.name} ({model.program})."]
    lines += [f"- {line}" for line in notes]
    if model.ignored:
        shown = [*model.ignored[:_MOST_SHOWN], *["..."] * (len(model.ignored) > _MOST_SHOWN)]
        lines.append(f"- left out, for no mechanics depend on it: {'; '.join(shown)}")
    wrapped = [part for line in lines for part in textwrap.wrap(line, 96, subsequent_indent="  ")]
    printable = ["".join(c if c.isprintable() else "?" for c in line) for line in wrapped]
    return "".join(f"# {line}\n" for line in printable)


def _volumes_of_nodes(model: Model) -> NDArray[np.float64]:
    """Integral of each node's shape function over the body, (num_nodes,)."""
    x = model.nodes[model.corners]
    volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
    found = np.zeros(len(model.nodes))
    quadratic = model.is_quadratic
    np.add.at(found, model.corners, np.where(quadratic, -0.05, 0.25)[:, None] * volumes[:, None])
    np.add.at(found, model.middles[quadratic], 0.2 * volumes[quadratic][:, None])
    return found


def _sorted(facets: Indices) -> list[list[int]]:
    rows: list[list[int]] = np.sort(facets, axis=1).tolist()
    return rows
