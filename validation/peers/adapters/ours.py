"""palpate itself, as it is timed beside the others; the one adapter that imports it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.contact.body_contact import VertexCellDetector
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.mesher import delaunay, mesh_surface
from palpate.fastsim.newton import MULTIGRID_FROM_POINTS
from palpate.fastsim.statics import solve_static
from palpate.fastsim.surface_remesher import mean_edge_length
from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem, Strain, TimeSpan
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface

# Wanted edge length inside, in mean edges of the surface: with it the number of cells is within
# 20 % of gmsh's, whose inner edges become longer than those of the surface.
_EDGES_INSIDE = 1.38
# Memory bandwidth of an H100 SXM, by NVIDIA's data sheet [bytes/s].
H100_BANDWIDTH = 3.35e12


class _Ours:
    version, precision = _core.__version__, "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._job = job


class Steps(_Ours):
    """The steps of `simulate` by default, with the energies that it sums at an output."""

    def __init__(self, job: dict[str, Any]) -> None:
        self.precision, self._element = str(job["precision"]), Element(str(job["element"]))
        self._body = ExplicitBody(
            _problem(job, TimeSpan(1.0, mass_damping=float(job["mass_damping"]))),
            element=self._element,
            time_step=float(job["time_step"]),
            precision=Precision(self.precision),
            num_threads=int(job["num_threads"]),
            device=str(job.get("device", "cpu")),
        )
        self._about = self._of_device() if self._body.instruction_set.count(":") else {}

    def _of_device(self) -> dict[str, Any]:
        num_cells = self._body.problem.mesh.num_cells
        return {
            "device": self._body.instruction_set,
            "bytes_per_cell": bytes_per_step(self._body) / num_cells,
            "copy_gigabytes_per_second": copy_bandwidth(self._body) / 1e9,
        }

    def advance(self, num_steps: int) -> dict[str, Any]:
        """Step from one output to the next."""
        self._body.step(num_steps)
        self._body.look()
        self._last = self._body.displacement
        return {
            "instruction_set": self._body.instruction_set,
            "element": self._element.value,
            "law": self._body.elastic.law.value,
            "critical_time_step": self._body.critical_time_step,
            **self._about,
        }


def bytes_per_step(body: ExplicitBody) -> int:
    """Bytes read and written in a step by all bodies of the batch that this one runs in.

    An array counts once for each launch that reads or writes it from end to end; points that
    several cells read are assumed to come from the cache after the first. What acts on the boundary
    alone (pressure, supports, tools) is left out. For the box of 600 000 cells, with 0.18 points a
    cell, in repeatable mode, bytes per cell and step are:

                             float32   float64
        linear tetrahedra        190       347
        smoothed ones            476       813

    Raises:
        InputError: A body of the compiled core.
    """
    from palpate.fastsim.gpu.launches import BLOCK

    launches = _launches(body)
    m, cells, scheme = launches.motion, launches.mesh, launches.scheme
    at_rest = _size(cells.corners, cells.gradients, cells.volumes)
    if cells.patches is None:
        kinds = _size(cells.kinds) if cells.num_kinds > 1 else 0
        forces = at_rest + kinds + _size(m.displacement)
    else:
        p = cells.patches
        forces = at_rest + _size(m.displacement, p.strains)
        forces += _size(p.strains, *_group(p.edges), p.stresses)
        forces += _size(p.strains, *_group(p.nodes), p.pressures)
        forces += at_rest + _size(m.displacement, p.cell_edges, p.cell_nodes)
        forces += _size(p.stresses, p.pressures)
    if cells.cell_forces.size:
        gathered = _size(cells.cell_forces) + _size(
            cells.cell_forces, *_group(cells.gather), m.force
        )
    else:
        gathered = 3 * _size(m.force)  # it is cleared, then read and written by the sums
    moved = _size(m.external, m.force, scheme.mobility) + 2 * _size(m.increment, m.displacement)
    looked = _size(m.mass, m.is_free, m.external, m.increment, m.displacement)
    looked += 2 * _size(m.counted, m.given, m.increment, m.displacement)
    return int(forces + gathered + moved + looked / BLOCK)


def paper_rate(bytes_per_cell: float, bandwidth: float = H100_BANDWIDTH) -> float:
    """Cells x steps per second that a bandwidth [bytes/s] allows at most: a bound, not a measure.

    On an H100 linear tetrahedra make at most 17.6e9 in float32 and 9.7e9 in float64.
    """
    return bandwidth / bytes_per_cell


def copy_bandwidth(body: ExplicitBody, *, megabytes: int = 256) -> float:
    """Bandwidth of copies on the body's device, bytes read and written [bytes/s]; see above."""
    return float(_launches(body).copy_bandwidth(megabytes * 1_000_000))


def _launches(body: ExplicitBody) -> Any:
    """What a body on a device launches in each step."""
    from palpate.fastsim.gpu.device_run import DeviceRun

    if not isinstance(body.run, DeviceRun):
        raise InputError("bytes and copies are counted of bodies on a device")
    return body.run.batch.launches


def _group(group: Any) -> list[Any]:
    """All arrays of a group."""
    return [array for name, array in vars(group).items() if name != "count"]


def _size(*arrays: Any) -> int:
    """Number of bytes of all arrays."""
    return sum(int(array.capacity) for array in arrays)


class Static(_Ours):
    """Solve from plain arrays to the displacement: mesh checks, assembly and solve."""

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """One whole solve."""
        problem = _problem(self._job)
        result = solve_static(
            problem,
            strain=Strain(str(self._job["strain"])),
            relative_tolerance=float(self._job["relative_tolerance"]),
        )
        uses_multigrid = problem.mesh.num_points >= MULTIGRID_FROM_POINTS
        self.result = {"displacement": result.displacement}
        return {
            "newton_iterations": result.iterations,
            "linear_iterations": result.linear_iterations,
            "method": "Newton, conjugate gradients, "
            + ("aggregation multigrid" if uses_multigrid else "diagonal blocks"),
        }


def _problem(job: dict[str, Any], time: TimeSpan | None = None) -> Problem:
    E, nu, rho = (float(job[name][0]) for name in ("youngs_modulus", "poissons_ratio", "density"))
    material = Material(E, nu, rho, Law(str(job.get("law", Law.SAINT_VENANT_KIRCHHOFF))))
    mesh = TetMesh(job["points"], job["cells"])
    fixed = np.flatnonzero(job["fixed"].all(axis=1)).astype(np.int32)
    load = PointForce(np.arange(mesh.num_points, dtype=np.int32), job["external_force"])
    return Problem(mesh, material, (Support(fixed),), (load,), time)


class Collision(_Ours):
    """Hashed voxels, filled anew in every step; each body is tested against both bodies."""

    def __init__(self, job: dict[str, Any]) -> None:
        super().__init__(job)
        pairs = [(1, 0), (0, 1)] + ([(0, 0), (1, 1)] if bool(job["with_self"]) else [])
        self._looks = [self._make_look(*pair) for pair in pairs]
        # Numbers of the second body follow those of the first.
        counts = np.array([job["frames"].shape[2], len(job["cells"])])
        found = [look(0) + counts * pair for look, pair in zip(self._looks, pairs, strict=True)]
        self.result = {"pairs": np.concatenate(found)}

    def _make_look(self, intruder: int, looked_at: int) -> Callable[[int], Any]:
        """A function that finds the pairs (intruder's vertex, cell of the other) in a frame."""
        is_same = intruder == looked_at
        here, there = self._job["frames"][looked_at], self._job["frames"][intruder]
        mesh = TetMesh(here[0], self._job["cells"])
        detector = VertexCellDetector(mesh, None if is_same else TetMesh(there[0], mesh.cells))

        def look(k: int) -> Any:
            found = detector.find(here[k], None if is_same else there[k])
            return np.column_stack([found.vertices, found.cells])

        return look

    def advance(self, num_steps: int) -> None:
        """Fill and query everything anew in each step."""
        for step in range(num_steps):
            for look in self._looks:
                look(step % len(self._job["frames"][0]))


class Delaunay(_Ours):
    """Delaunay tetrahedra of points."""

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        cells, _ = delaunay(self._job["points"])
        self.result = {"num_cells": np.array(len(cells))}


class Mesh(_Ours):
    """A surface filled with tetrahedra, its own facets unchanged."""

    def __init__(self, job: dict[str, Any]) -> None:
        surface = self._surface = TriSurface(job["points"], job["facets"])
        # Asked for, as a number that a user types.
        self._edge_length = _EDGES_INSIDE * mean_edge_length(surface.points, surface.facets)

    def advance(self, _num_steps: int) -> None:
        """Mesh from the surface to the finished mesh, clean-up included."""
        mesh = mesh_surface(self._surface, edge_length=self._edge_length, lengthens_step=True)
        self.result = {"points": mesh.points, "cells": mesh.cells}
