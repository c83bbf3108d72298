"""What acts on a model as tables of a case, and the groups of its mesh that they name."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.nodal_arrays import area_vectors
from palpate.validation.importing.model import Face, Hold, ImportRefusedError, Model
from palpate.validation.importing.nodal_forces import fit_body_force, fit_tractions

# Tables of loads that differ from point to point; a file with more is no longer read by people.
MOST_TABLES = 500


@dataclass(eq=False)
class Acting:
    """Tables of a case, and named groups of the mesh."""

    supports: list[dict[str, Any]] = field(default_factory=list)
    loads: list[dict[str, Any]] = field(default_factory=list)
    facets: dict[str, Indices] = field(default_factory=dict)
    points: dict[str, Indices] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)
    has_point_forces: bool = False
    taken: frozenset[str] = frozenset()

    def name(self, wanted: str) -> str:
        """A name for a group that no other has, in the letters that a mesh file allows."""
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "-", wanted).strip("-")[:48] or "group"
        taken = {*self.facets, *self.points, *self.taken}
        names = (plain if k == 1 else f"{plain}-{k}" for k in range(1, len(taken) + 2))
        return next(name for name in names if name not in taken)


class Places:
    """A model's nodes as points of the case's mesh; in the model's units of length."""

    def __init__(self, model: Model, mesh: TetMesh, point_of: NDArray[np.int64]) -> None:
        self.model, self.mesh, self.point_of = model, mesh, point_of
        self.rows = {tuple(row): k for k, row in enumerate(_sorted(mesh.boundary_facets))}
        quadratic = (model.middles >= 0).all(axis=1)
        ends = model.corners[quadratic][:, [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]]
        self.ends = dict(
            zip(
                model.middles[quadratic].ravel().tolist(),
                map(tuple, ends.reshape(-1, 2).tolist()),
                strict=True,
            )
        )
        self.middle_of = {tuple(sorted(pair)): node for node, pair in self.ends.items()}

    def facet_middles(self) -> NDArray[np.int64]:
        """Nodes half-way along the edges of the boundary's facets, as nodes; -1 without."""
        node_of = np.flatnonzero(self.point_of >= 0)
        nodes = node_of[np.argsort(self.point_of[node_of])][self.mesh.boundary_facets]
        pairs = nodes[:, [[0, 1], [1, 2], [2, 0]]].tolist()
        found = [[self.middle_of.get((min(pair), max(pair)), -1) for pair in row] for row in pairs]
        return np.array(found, dtype=np.int64).reshape(-1, 3)

    def points_of(self, hold: Hold) -> Indices:
        """Points that stand for held nodes.

        Raises:
            ImportRefusedError: A middle node that is held where an end of its edge is not.
        """
        held = set(hold.nodes.tolist())
        points = {int(p) for p in self.point_of[hold.nodes] if p >= 0}
        loose = 0
        for node in held:
            if self.point_of[node] >= 0:
                continue
            if node not in self.ends:
                loose += 1
            elif not held.issuperset(self.ends[node]):
                raise hold.place.refuse(
                    f"{hold.name} holds the middle node {self.model.labels[node]} of an edge whose "
                    "ends it does not hold both; a case has corner nodes only: hold whole faces"
                )
        if loose:
            self.model.told.append(f"{hold.name}: {loose} held node(s) of no element are left out")
        return np.array(sorted(points), dtype=np.int32)

    def boundary_rows(self, face: Face) -> tuple[Indices, NDArray[np.bool_]]:
        """Rows of the boundary's facets, and which the file gives the other way round.

        Raises:
            ImportRefusedError: A facet that is none of the boundary.
        """
        facets = self.point_of[face.facets].astype(np.int32)
        rows = [self.rows.get(tuple(row), -1) for row in _sorted(facets)]
        if -1 in rows:
            guilty = self.model.labels[face.facets[rows.index(-1)]].tolist()
            raise face.place.refuse(
                f"{face.name}: the facet of nodes {guilty} is none of the body's boundary"
            )
        if len(set(rows)) < len(rows):
            raise face.place.refuse(f"{face.name}: a facet is named twice")
        ours = self.mesh.boundary_facets[rows]
        vectors = area_vectors(self.mesh.points, ours), area_vectors(self.mesh.points, facets)
        return np.array(rows, dtype=np.int32), np.sum(vectors[0] * vectors[1], axis=1) < 0.0


def acting_tables(places: Places, accelerate: Any, taken: Iterable[str]) -> Acting:
    """Supports and loads of a model as tables of a case.

    Args:
        places: Of the model.
        accelerate: Turns a force by volume into an acceleration in m/s2.
        taken: Names of other groups of the mesh.

    Raises:
        ImportRefusedError: What a case cannot say.
    """
    acting = Acting(taken=frozenset(taken))
    _supports(acting, places)
    for face in places.model.faces:
        _face_load(acting, places, face)
    _nodal_forces(acting, places, accelerate)
    return acting


def _supports(acting: Acting, places: Places) -> None:
    wanted: dict[tuple[int, int], tuple[float, Hold]] = {}
    kept: list[tuple[Hold, Indices]] = []
    for hold in places.model.holds:
        points = places.points_of(hold)
        for point in points.tolist():
            for axis, value in hold.components.items():
                other, by = wanted.setdefault((point, axis), (value, hold))
                if other != value:
                    raise hold.place.refuse(
                        f"{hold.name} moves a node along {'xyz'[axis]} by {value:g} that {by.name} "
                        f"(line {by.place.line}) moves by {other:g}; hold it once"
                    )
        if len(points):
            kept.append((hold, points))
    if len(kept) > MOST_TABLES:
        raise kept[MOST_TABLES][0].place.refuse(
            f"displacements are prescribed in {len(kept)} different ways, more than the "
            f"{MOST_TABLES} tables a case is given here; a turn or a uniform displacement of a "
            "whole face can be said in one [[support]] by hand"
        )
    for hold, points in kept:
        facets, single = _held_facets(places.mesh, points)
        regions = []
        if len(facets):
            regions.append(acting.name(hold.name))
            acting.facets[regions[-1]] = facets
        if len(single):
            regions.append(acting.name(f"{hold.name}-points" if len(facets) else hold.name))
            acting.points[regions[-1]] = single
        for region in regions:
            table: dict[str, Any] = {"region": {"group": region}}
            if len(hold.components) < 3:
                table["components"] = ["xyz"[axis] for axis in sorted(hold.components)]
            if any(hold.components.values()):
                table["displacement"] = [hold.components.get(axis, 0.0) for axis in range(3)]
            acting.supports.append(table)


def _held_facets(mesh: TetMesh, points: Indices) -> tuple[Indices, Indices]:
    """Boundary facets whose corners are all held, and held points of none of them."""
    is_held = np.zeros(mesh.num_points, dtype=bool)
    is_held[points] = True
    facets = mesh.boundary_facets[is_held[mesh.boundary_facets].all(axis=1)]
    return facets, np.setdiff1d(points, facets).astype(np.int32)


def _face_load(acting: Acting, places: Places, face: Face) -> None:
    rows, is_turned = places.boundary_rows(face)
    for chosen, sign in ((~is_turned, 1.0), (is_turned, -1.0)):
        if not chosen.any():
            continue
        table: dict[str, Any]
        if face.pressure is not None:
            table = {"kind": "pressure", "pressure": sign * face.pressure}
        else:
            # A traction has its own direction, whichever way a facet looks.
            chosen = np.ones(len(rows), dtype=bool)
            table = {"kind": "traction", "traction": list(face.traction or ())}
        name = acting.name(face.name)
        acting.facets[name] = places.mesh.boundary_facets[rows[chosen]]
        acting.loads.append({**table, "region": {"group": name}})
        if face.pressure is None:
            return


def _nodal_forces(acting: Acting, places: Places, accelerate: Any) -> None:
    model, mesh, forces = places.model, places.mesh, places.model.forces
    if not forces.any():
        return
    unused = (places.point_of < 0) & forces.any(axis=1)
    unused[list(places.ends)] = False
    if unused.any():
        label = int(model.labels[np.argmax(unused)])
        raise ImportRefusedError(model.path, None, f"a force on node {label}, which no element has")
    node_of = np.flatnonzero(places.point_of >= 0)
    node_of = node_of[np.argsort(places.point_of[node_of])]
    corners, middles = node_of[mesh.boundary_facets], places.facet_middles()
    is_inside = np.ones(len(forces), dtype=bool)
    is_inside[corners] = False
    is_inside[middles[middles >= 0]] = False
    weights = _volume_shares(model)
    density = fit_body_force(weights, is_inside & (weights != 0.0), forces)
    if density is not None:
        forces = forces - weights[:, None] * density
        noise = 1e-9 * np.abs(model.forces).max()
        forces[np.abs(forces).max(axis=1) <= noise] = 0.0
        acting.loads.append({"kind": "gravity", "acceleration": accelerate(density)})
        acting.told.append("forces on inner nodes are those of a uniform weight: read as gravity")
    fitted, left = fit_tractions(model.nodes, corners, middles, forces)
    for number, traction in enumerate(fitted, 1):
        name = acting.name("nodal-forces" if len(fitted) == 1 else f"nodal-forces-{number}")
        acting.facets[name] = places.point_of[traction.facets].astype(np.int32)
        values = traction.values.tolist()
        pushed: dict[str, Any] = {"kind": "traction", "region": {"group": name}}
        if len(values) == 1:
            pushed["traction"] = values[0]
        else:
            at = traction.places.tolist()
            pushed["values"] = [{"at": a, "traction": t} for a, t in zip(at, values, strict=True)]
        acting.loads.append(pushed)
        kind = "a uniform" if len(values) == 1 else "an affine"
        acting.told.append(
            f"forces on nodes are those of {kind} traction on {len(traction.facets)} facets: "
            f"read as one on {name}"
        )
    _point_forces(acting, places, left)


def _point_forces(acting: Acting, places: Places, forces: Points) -> None:
    model = places.model
    loaded = np.flatnonzero(forces.any(axis=1))
    if not len(loaded):
        return
    middles = [node for node in loaded.tolist() if places.point_of[node] < 0]
    if middles:
        raise ImportRefusedError(
            model.path, None,
            f"forces on nodes are those of no traction, and node {model.labels[middles[0]]} is a "
            "middle node, which a case does not have; give a pressure or a traction on the face",
        )  # fmt: skip
    kinds, which = np.unique(forces[loaded], axis=0, return_inverse=True)
    if len(kinds) > MOST_TABLES:
        raise ImportRefusedError(
            model.path, None,
            f"forces on {len(loaded)} nodes are those of no uniform or affine traction, and are "
            f"{len(kinds)} different ones (at most {MOST_TABLES} here); give a pressure or a "
            "traction on the face in their place",
        )  # fmt: skip
    for number, force in enumerate(kinds):
        name = acting.name(f"forces-{number + 1}")
        nodes = loaded[which.ravel() == number]
        acting.points[name] = places.point_of[nodes].astype(np.int32)
        acting.loads.append(
            {"kind": "point_force", "region": {"group": name}, "force": force.tolist()}
        )
    acting.has_point_forces = True
    acting.told.append(
        f"forces on {len(loaded)} node(s) are those of no uniform or affine traction: they stay "
        "forces on points, under which displacements have no limit; no truth is possible, only "
        "checks on the same mesh"
    )


def _volume_shares(model: Model) -> NDArray[np.float64]:
    """Of each node the integral of its shape function over the body, (num_nodes,)."""
    x = model.nodes[model.corners]
    volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
    shares = np.zeros(len(model.nodes))
    quadratic = (model.middles >= 0).all(axis=1)
    np.add.at(shares, model.corners, np.where(quadratic, -0.05, 0.25)[:, None] * volumes[:, None])
    np.add.at(shares, model.middles[quadratic], 0.2 * volumes[quadratic][:, None])
    return shares


def _sorted(facets: Iterable[Any]) -> list[list[int]]:
    rows: list[list[int]] = np.sort(np.asarray(facets), axis=1).tolist()
    return rows
