"""SOFA (`runSofa` with SofaPython3): linear tetrahedra at rest, by StaticSolver.

Finite strain is TetrahedronHyperelasticityFEMForceField, whose StVenantKirchhoff, NeoHookean and
StableNeoHookean take Lamé's mu and lambda; small strain is TetrahedronFEMForceField, method small.
The loads of a case arrive as forces of its points, weight among them, so that no mass is needed.
The scene is a Python file beside its arrays; a controller in it raises forces and supports in parts
and writes the last positions in double precision. SOFA 25.06 is the first with a Newton solver of
its own (its change log, "Refactor StaticSolver to use NewtonRaphsonSolver").

    palpate gate CASE --simulator "python sofa.py {case} {result}"
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness import force_scale, lame, load_parts, read_arrays, solve_case

# Of the force scale; at most so many iterations in each part of the load.
_LEFT, _MOST = 1e-9, 100
_ARRAYS = ("points", "cells", "fixed", "prescribed_displacement", "external_force")
_LAWS = {
    "saint-venant-kirchhoff": "StVenantKirchhoff",
    "neo-hookean": "NeoHookean",
    "neo-hookean-stable": "StableNeoHookean",
}
_SCENE = '''"""A body at rest under dead loads."""

import numpy as np
import Sofa

FOLDER, NUM_PARTS, TOLERANCE, MOST = {folder!r}, {num_parts}, {tolerance!r}, {most}
FORCE_FIELD, CONSTANTS = {force_field!r}, {constants!r}
BODY = np.load(FOLDER + "/body.npz")
POINTS, FIXED = BODY["points"], BODY["fixed"].astype(bool)


class Loading(Sofa.Core.Controller):
    """Raises the load, and writes where the points are at its end."""

    def __init__(self, *args, **kwargs):
        Sofa.Core.Controller.__init__(self, *args, **kwargs)
        self.state, self.load, self.newton = (kwargs[k] for k in ("state", "load", "newton"))
        self.step, self.has_failed = 0, False

    def onAnimateBeginEvent(self, event):
        self.step += 1
        part = self.step / NUM_PARTS
        with self.load.forces.writeableArray() as forces:
            forces[:] = part * BODY["external_force"]
        with self.state.position.writeableArray() as position:
            position[FIXED] = (POINTS + part * BODY["prescribed_displacement"])[FIXED]

    def onAnimateEndEvent(self, event):
        status = self.newton.findData("status").getValueString()
        if "Converged" not in status and not self.has_failed:
            print(f"part {{self.step}} of {{NUM_PARTS}} of the load: {{status}}", flush=True)
            self.has_failed = True
        if self.step == NUM_PARTS and not self.has_failed:
            version = getattr(Sofa, "GetVersion", lambda: "?")()
            position = np.array(self.state.position.array())
            np.savez(FOLDER + "/positions.npz", position=position, version=version)


def createScene(root):
    root.gravity = [0.0, 0.0, 0.0]
    modules = ("Constraint.Projective", "LinearSolver.Direct", "MechanicalLoad")
    modules += ("ODESolver.Backward", "SolidMechanics.FEM.Elastic", "StateContainer")
    for name in (*modules, "SolidMechanics.FEM.HyperElastic", "Topology.Container.Constant"):
        root.addObject("RequiredPlugin", pluginName="Sofa.Component." + name)
    root.addObject("DefaultAnimationLoop")
    body = root.addChild("body")
    newton = body.addObject(
        "NewtonRaphsonSolver", name="newton", maxNbIterationsNewton=MOST,
        absoluteResidualStoppingThreshold=TOLERANCE, maxNbIterationsLineSearch=5,
        relativeSuccessiveStoppingThreshold=0, relativeInitialStoppingThreshold=0)
    body.addObject("StaticSolver", newtonSolver="@newton")
    body.addObject("EigenSimplicialLDLT", template="CompressedRowSparseMatrixMat3x3")
    points = POINTS.tolist()
    body.addObject("MeshTopology", position=points, tetrahedra=BODY["cells"].tolist())
    state = body.addObject("MechanicalObject", position=points, rest_position=points)
    body.addObject(FORCE_FIELD, **CONSTANTS)
    for pattern in np.unique(FIXED[FIXED.any(axis=1)], axis=0):
        indices = np.flatnonzero((FIXED == pattern).all(axis=1)).tolist()
        kind, which = "FixedProjectiveConstraint", {{}}
        if not pattern.all():
            kind, which = "Partial" + kind, {{"fixedDirections": pattern.astype(int).tolist()}}
        body.addObject(kind, indices=indices, **which)
    every, zeros = list(range(len(POINTS))), np.zeros_like(POINTS).tolist()
    load = body.addObject("ConstantForceField", indices=every, forces=zeros)
    root.addObject(Loading(name="loading", state=state, load=load, newton=newton))
'''


class Static:
    """A solve is one run of the program, which loads the scene and makes a step for each part."""

    tool, version, precision = "SOFA", "?", "float64"
    laws = tuple(_LAWS)

    def __init__(self, job: dict[str, Any]) -> None:
        program = shutil.which("runSofa")
        if program is None:
            raise ImportError("runSofa is not on the path; it comes from sofa-framework.org")
        self._program, self._job = program, job
        E, nu = float(job["youngs_modulus"][0]), float(job["poissons_ratio"][0])
        lmbda, mu = lame(job)
        if str(job["strain"]) == "linear":
            if nu < 0.0:
                raise ValueError("SOFA takes 0.45 for a Poisson's ratio below 0")
            self._force_field = "TetrahedronFEMForceField"
            self._constants = {"youngModulus": E, "poissonRatio": nu, "method": "small"}
        else:
            self._force_field = "TetrahedronHyperelasticityFEMForceField"
            both = f"{mu!r} {lmbda!r}"
            self._constants = {"materialName": _LAWS[job["law"]], "ParameterSet": both}
        self.result: dict[str, Any] = {}

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Run it to the full load."""
        job, num_parts = self._job, len(load_parts(self._job))
        with tempfile.TemporaryDirectory() as folder:
            np.savez(Path(folder, "body.npz"), **{name: job[name] for name in _ARRAYS})
            text = _SCENE.format(
                folder=folder, num_parts=num_parts, tolerance=_LEFT * force_scale(job), most=_MOST,
                force_field=self._force_field, constants=self._constants,
            )  # fmt: skip
            scene = Path(folder, "scene.py")
            scene.write_text(text, encoding="utf-8")
            options = ["-l", "SofaPython3", "-g", "batch", "-n", str(num_parts), str(scene)]
            done = subprocess.run(
                [self._program, *options], cwd=folder, capture_output=True, text=True, check=False
            )
            written = Path(folder, "positions.npz")
            found = read_arrays(written) if written.is_file() else None
        if found is None:
            print(done.stderr[-2000:], done.stdout[-2000:])
            raise SystemExit(f"runSofa ended with {done.returncode} and wrote no positions")
        self.version = str(found["version"]).lstrip("v")
        self.result = {"displacement": found["position"] - job["points"]}
        return {"method": "StaticSolver, Newton, EigenSimplicialLDLT"}


if __name__ == "__main__":
    solve_case(Static)
