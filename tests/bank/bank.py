"""A bank of bodies for tests: boxes of tetrahedra with named faces, and what holds them."""

from __future__ import annotations

import itertools

import numpy as np

from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.problem import Element, Inclusion, Material, Problem
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.reference.result import Formulation

FACES = {"x0": (0, 0), "x1": (0, 1), "y0": (1, 0), "y1": (1, 1), "z0": (2, 0), "z1": (2, 1)}


# Options of the reference's solvers for each kind of tetrahedra that it has.
KINDS = {
    "linear": {},
    "smoothed": {"element": Element.SMOOTHED},
    "quadratic": {"degree": 2},
    "mixed": {"degree": 2, "formulation": Formulation.MIXED},
}


def make_box(counts=(2, 2, 2), size=(1.0, 1.0, 1.0), jitter=0.0) -> TetMesh:
    """Six tetrahedra per brick; inside points moved by `jitter` of a brick, at random."""
    counts = np.asarray(counts)
    axes = [np.linspace(0.0, s, n + 1) for s, n in zip(size, counts, strict=True)]
    points = np.array(list(itertools.product(*axes)))
    strides = np.array([(counts[1] + 1) * (counts[2] + 1), counts[2] + 1, 1])
    cells = []
    for corner in itertools.product(*map(range, counts)):
        for order in itertools.permutations(range(3)):
            walk = [np.array(corner)]
            for axis in order:
                walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
            cells.append([int(strides @ w) for w in walk])
    cells = np.array(cells)
    turned = signed_volumes(points, cells) < 0.0
    cells[turned] = cells[turned][:, [0, 2, 1, 3]]
    inside = np.all((points > 0.0) & (points < np.asarray(size)), axis=1)
    shift = np.random.default_rng(7).uniform(-jitter, jitter, (int(inside.sum()), 3))
    points[inside] += shift * np.asarray(size) / counts
    bare = TetMesh(points, cells)
    facets = bare.boundary_facets
    groups = {
        name: facets[np.all(points[facets][:, :, axis] == end * size[axis], axis=1)]
        for name, (axis, end) in FACES.items()
    }
    return TetMesh(points, cells, facet_groups=groups)


def fixed(facets, components=(True, True, True), displacement=(0.0, 0.0, 0.0), **more) -> Support:
    """A support of all points of some facets."""
    return Support(np.unique(facets).astype(np.int32), facets, components, displacement, **more)


def support(mesh, face="x0", components=(True, True, True), displacement=(0.0, 0.0, 0.0), **more):
    """A support of a named face of a box."""
    return fixed(mesh.facet_groups[face], components, displacement, **more)


def along_normals(mesh, faces):
    """Faces of a box that slide in their own planes."""
    axes = np.eye(3, dtype=bool)
    return tuple(support(mesh, face, tuple(axes[FACES[face][0]])) for face in faces)


def rollers(mesh):
    """The planes x = 0, y = 0, z = 0 slide in themselves."""
    return along_normals(mesh, ("x0", "y0", "z0"))


def confined(mesh):
    """A bar that can only lengthen, from x = 0."""
    return along_normals(mesh, ("x0", "y0", "y1", "z0", "z1"))


def beyond(mesh, x) -> np.ndarray:
    """Cells whose centres are beyond a position along the first axis."""
    return np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > x).astype(np.int32)


def loaded_bar(counts=(4, 2, 2), *, inclusion=None, loads=()) -> Problem:
    """A ragged bar of 0.4 m, clamped at one end, under loads of all kinds, those given last."""
    mesh = make_box(counts, (0.4, 0.1, 0.1), jitter=0.2)
    of_all = (
        BodyForce((0.0, 200.0, -600.0)),
        Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
        PointForce(np.array([mesh.num_points - 1], np.int32), np.array([[0.0, 0.3, 0.0]])),
    )
    inclusions = () if inclusion is None else (Inclusion(beyond(mesh, 0.2), inclusion),)
    of_all += tuple(load(mesh) for load in loads)
    clamp = (support(mesh),)
    return Problem(mesh, Material(2e4, 0.4), clamp, of_all, inclusions=inclusions)


def pressure(mesh):
    """On the upper side."""
    return Pressure(mesh.facet_groups["z1"], 80.0)


def lumped_mass(problem) -> np.ndarray:
    """A quarter of each cell's mass to its corners [kg], (num_points,)."""
    mesh = problem.mesh
    density = np.full(mesh.num_cells, problem.material.density)
    for inclusion in problem.inclusions:
        density[inclusion.cells] = inclusion.material.density
    mass = np.zeros(mesh.num_points)
    np.add.at(mass, mesh.cells, (density * signed_volumes(mesh.points, mesh.cells) / 4)[:, None])
    return mass


# Of P waves in it: sqrt((lmbda + 2 mu) / rho) with E = 1, nu = 0.3, rho = 1.
SPEED = 1.16023870


def confined_bar(count, span):
    """A bar of 1 m that can only lengthen, of so many bricks."""
    mesh = make_box((count, 1, 1), (1.0, 0.1, 0.1))
    return Problem(mesh, Material(1.0, 0.3, 1.0), confined(mesh), (), span)


def first_mode(points):
    """Its slowest free motion, 1 mm at the end."""
    shape = np.zeros_like(points)
    shape[:, 0] = 1e-3 * np.sin(0.5 * np.pi * points[:, 0])
    return shape


def made_state(mesh, displacement, **more):
    """A made-up state of a body, measured by its displacement; under Green strain unless said."""
    from palpate.meshes.problem import Strain
    from palpate.validation.metrics import make_state

    words = {"label": "x", "simulator": "x", "strain": Strain.GREEN, **more}
    return make_state(mesh, displacement, **words)
