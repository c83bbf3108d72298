"""Drake's deformable bodies at rest: linear tetrahedra, kLinearCorotated, kNeoHookean or kLinear.

    palpate gate CASE --simulator "python drake_bodies.py {case} {result}"

Drake has no solver for statics and no forces on points. A step of its scheme (Newmark, gamma 1,
beta 1/2, velocities v) from the velocity k = dt/2 M^-1 f ends at positions q with
2/dt^2 M (q - q_0) = f_int(q) + f: it descends to the equilibrium of the dead forces f. So every
step begins from k, until M (v + k) / dt, which is out of balance, is nothing. M is Drake's mass
matrix, of one point in a cell. Weight is its own gravity, with k = 0. Walls of zero displacement
are half spaces: what is fixed has to be whole points behind planes along the axes.

kLinearCorotated takes the rotation of each cell from the step before: at rest its force is that of
the corotational law. kNeoHookean is mu/2 (I - 3) + L/2 (J - 1 - mu/L)^2, with Lamé's lambda of its
E and nu for L, which is lambda + mu of the body asked for: E and nu are chosen so, and handed over
as they are by `constants=documented`. It bears weight alone here: Newton's method ends at a part of
the first residual of a step.
"""

from __future__ import annotations

import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import harness
import numpy as np
from pydrake.geometry import GeometryInstance, Mesh, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.fem import DeformableBodyConfig, MaterialModel
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

# Parts of the load; the force scale in a unit in which Drake's own tolerance, 1e-6, is small.
_LEFT, _ENOUGH, _SCALE, _MOST = 1e-9, 1e-7, 1e6, 20_000


class Static:
    """A plant with one body."""

    tool, version, precision = "Drake", version("drake"), "float64"
    laws = ("corotational", "neo-hookean-stable", "saint-venant-kirchhoff")

    def __init__(self, job: dict[str, Any]) -> None:
        harness.require_fixed_points(job)
        self._job, points, cells = job, job["points"], job["cells"]
        fixed, unit = job["fixed"].astype(bool).all(axis=1), _SCALE / harness.force_scale(job)
        rho, size = float(job["density"][0]), float(np.ptp(points, axis=0).max())
        model, E, nu = _material(job)
        # Longer steps are fewer, but the rotations of kLinearCorotated are behind by one.
        self._dt = 5.0 * size * float(np.sqrt(rho / (unit * E)))
        rows, columns = np.repeat(cells, 4, axis=1).ravel(), np.tile(cells, (1, 4)).ravel()
        sixteenths = np.repeat(rho * harness.all_gradients(job)[1] / 16.0, 16)
        self._mass = coo_matrix((sixteenths, (rows, columns)), 2 * (len(points),)).tocsr()
        load, lumped = unit * job["external_force"], np.asarray(self._mass.sum(axis=1))
        self._free, self._kick, gravity = ~fixed, np.zeros_like(load), load.sum(0) / lumped.sum()
        if np.abs(load - lumped * gravity).max() > 1e-9 * np.abs(load).max():
            if model is MaterialModel.kNeoHookean:
                raise ValueError("kNeoHookean bears weight alone here")
            inverse = splu(self._mass[self._free][:, self._free].tocsc())
            self._kick[self._free] = 0.5 * self._dt * inverse.solve(load[self._free])
            gravity = np.zeros(3)
        config = DeformableBodyConfig()
        config.set_youngs_modulus(unit * E)
        config.set_poissons_ratio(nu)
        config.set_mass_density(rho)
        config.set_material_model(model)
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, self._dt)
        plant.mutable_gravity_field().set_gravity_vector(gravity)
        self._model = plant.mutable_deformable_model()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "body.vtk")
            file.write_text(_vtk(points, cells), encoding="utf-8")
            instance = GeometryInstance(RigidTransform(), Mesh(str(file)), "body")
            instance.set_proximity_properties(ProximityProperties())
            self._body = self._model.RegisterDeformableBody(instance, config, size)
        for at, normal in _walls(points, fixed):
            self._model.SetWallBoundaryCondition(self._body, at, normal)
        plant.Finalize()
        self._simulator = Simulator(builder.Build())
        root = self._simulator.get_mutable_context()
        self._context = plant.GetMyMutableContextFromRoot(root)
        self.result: dict[str, Any] = {}

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Step to rest."""
        context, body, left, count = self._context, self._body, np.inf, 0
        while left > _LEFT and count < _MOST:
            self._model.SetVelocities(context, body, self._kick.T)
            count += 1
            self._simulator.AdvanceTo(count * self._dt)
            moved = self._model.GetVelocities(context, body).T + self._kick
            left = float(np.linalg.norm((self._mass @ moved)[self._free]) / (self._dt * _SCALE))
        harness.require_rest(left, _ENOUGH)
        moved = self._model.GetPositions(context, body).T - self._job["points"]
        self.result = {"displacement": moved}
        method = f"its own steps to rest, {count} of {self._dt:.3g} s"
        return {"method": method, "relative_residual": left}


def _material(job: dict[str, Any]) -> tuple[Any, float, float]:
    """Its model, Young's modulus [Pa] and Poisson's ratio."""
    E, nu = float(job["youngs_modulus"][0]), float(job["poissons_ratio"][0])
    if str(job["strain"]) == "linear":
        return MaterialModel.kLinear, E, nu
    if job["law"] == "saint-venant-kirchhoff":
        raise ValueError("law saint-venant-kirchhoff: Drake has no such bodies")
    if job["law"] == "corotational":
        return MaterialModel.kLinearCorotated, E, nu
    if job.get("constants") != "documented":
        lmbda, mu = harness.lame(job)
        nu = (lmbda + mu) / (2.0 * (lmbda + 2.0 * mu))
        E = 2.0 * mu * (1.0 + nu)
    return MaterialModel.kNeoHookean, E, nu


def _walls(points: Any, fixed: Any) -> list[tuple[Any, Any]]:
    """Point and normal of planes along the axes behind which exactly the fixed points lie.

    Raises ValueError where these do not have them all.
    """
    found, covered = [], np.zeros(len(points), dtype=bool)
    for normal in (*np.eye(3), *-np.eye(3)):
        height = points @ normal
        first = height[~fixed].min()
        behind = height < first
        if behind.any():
            found.append((0.5 * (height[behind].max() + first) * normal, normal))
            covered |= behind
    if not np.array_equal(covered, fixed):
        raise ValueError("what is fixed does not lie behind planes along the axes")
    return found


def _vtk(points: Any, cells: Any) -> str:
    """Tetrahedra as a legacy VTK file."""
    rows = ["# vtk DataFile Version 3.0", "body", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    rows += [f"POINTS {len(points)} double", *(" ".join(map("{:.17g}".format, p)) for p in points)]
    rows += [f"CELLS {len(cells)} {5 * len(cells)}", *("4 " + " ".join(map(str, c)) for c in cells)]
    return "\n".join([*rows, f"CELL_TYPES {len(cells)}", *(["10"] * len(cells)), ""])


if __name__ == "__main__":
    harness.solve_case(Static)
