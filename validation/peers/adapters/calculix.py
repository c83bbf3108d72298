"""CalculiX (`ccx`): linear tetrahedra C3D4; NLGEOM makes its linear law Saint-Venant-Kirchhoff.

Its HYPERELASTIC laws NEO HOOKE and MOONEY-RIVLIN split shape and volume, with D1 = 2 / kappa.

    palpate gate CASE --simulator "python calculix.py {case} {result}"

With `degree=2` behind these it takes quadratic tetrahedra C3D10 on the case's mesh, and its result
is on the cells cut in eight. Its result has seven digits (a text file).
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness import children_memory_mb, lame, solve_case
from nodes import Points, nodes_of

# Residual over the mean force, and correction over displacement; ccx's defaults: 5e-3, 1e-2.
_TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-6, , , 1e-9, , ,"
# What ccx calls a solver -> what it is.
_SOLVERS = {
    "SPOOLES": "direct solver",
    "ITERATIVE CHOLESKY": "conjugate gradients, incomplete Cholesky",
}


class Static:
    """A solve is one run of the program, which reads its input file and writes every point."""

    tool, precision = "CalculiX", "float64"
    laws = ("saint-venant-kirchhoff", "neo-hookean-isochoric", "mooney-rivlin")

    def __init__(self, job: dict[str, Any]) -> None:
        program = shutil.which("ccx")
        if program is None:
            raise ImportError("ccx is not on the path")
        said = subprocess.run([program, "-v"], capture_output=True, text=True, check=False).stdout
        self.version = (re.findall(r"[\d.]+\d", said) or ["?"])[0]
        self._program = program
        self._solver = str(job.get("solver", "SPOOLES"))
        self._nodes = nodes_of(job)
        kind = "C3D4" if isinstance(self._nodes, Points) else "C3D10"
        self.tool = self.tool if kind == "C3D4" else "CalculiX C3D10"
        body = self._nodes.arrays
        self._num_points = len(body["points"])
        self._input = _input_file({**job, **body}, kind, self._solver)
        self.result: dict[str, Any] = {}

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Run it to the full load."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "body.inp").write_text(self._input, encoding="utf-8")
            done = subprocess.run(
                [self._program, "body"], cwd=folder, capture_output=True, text=True, check=False
            )
            table = Path(folder, "body.dat")
            text = table.read_text(encoding="utf-8") if table.is_file() else ""
        last = text[text.rfind("displacements") :]
        rows = [line.split() for line in last.splitlines() if re.match(r"\s+\d+\s+\S+E", line)]
        if done.returncode or len(rows) != self._num_points or "time  0.1000000E+01" not in last:
            raise SystemExit(f"ccx ended with {done.returncode} before the full load")
        numbered = np.array(rows, dtype=float)
        self.result = self._nodes.result(numbered[numbered[:, 0].argsort(), 1:])
        iterations = re.findall(r"^ iteration +\d+", done.stdout, re.MULTILINE)
        memory = children_memory_mb()
        return {
            "newton_iterations": max(1, len(iterations)),
            **({"peak_memory_mb": memory} if memory else {}),  # Windows does not tell it
            "method": f"Newton, {_SOLVERS[self._solver]}",
        }


def _input_file(job: dict[str, Any], kind: str, solver: str) -> str:
    """The input file; numbers begin at 1, and ccx reduces load increments by itself."""
    is_linear = str(job["strain"]) == "linear"
    num_parts = 1 if is_linear else int(job.get("load_parts", 1))
    rows = ["*NODE, NSET=ALL"]
    rows += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(job["points"], 1)]
    rows += [f"*ELEMENT, TYPE={kind}, ELSET=BODY"]
    rows += [f"{i}, " + ", ".join(map(str, c + 1)) for i, c in enumerate(job["cells"], 1)]
    rows += ["*MATERIAL, NAME=TISSUE", *_law(job)]
    rows += ["*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE"]
    rows += ["*STEP, INC=1000" if is_linear else "*STEP, NLGEOM, INC=1000"]
    rows += [f"*STATIC, SOLVER={solver}", f"{1.0 / num_parts}, 1., 1e-4, 1."]
    rows += [] if is_linear else [_TIGHT]
    rows += ["*BOUNDARY"]
    for point, axis in zip(*np.nonzero(job["fixed"]), strict=True):
        moved = job["prescribed_displacement"][point, axis]
        rows.append(f"{point + 1}, {axis + 1}, {axis + 1}, {moved:.12e}")
    rows += ["*CLOAD"]
    for point, axis in zip(*np.nonzero(job["external_force"]), strict=True):
        rows.append(f"{point + 1}, {axis + 1}, {job['external_force'][point, axis]:.12e}")
    return "\n".join([*rows, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def _law(job: dict[str, Any]) -> list[str]:
    """The cards of the material, which is the same everywhere."""
    law = job.get("law", "saint-venant-kirchhoff")
    if law == "saint-venant-kirchhoff":
        return ["*ELASTIC", f"{job['youngs_modulus'][0]:.15g}, {job['poissons_ratio'][0]:.15g}"]
    lmbda, mu = lame(job)
    c01 = float(job["c01"][0]) if law == "mooney-rivlin" else 0.0
    c10, d1 = mu / 2.0 - c01, 2.0 / (lmbda + 2.0 * mu / 3.0)
    if law == "mooney-rivlin":
        return ["*HYPERELASTIC, MOONEY-RIVLIN", f"{c10:.15g}, {c01:.15g}, {d1:.15g}"]
    return ["*HYPERELASTIC, NEO HOOKE", f"{c10:.15g}, {d1:.15g}"]


if __name__ == "__main__":
    solve_case(Static)
