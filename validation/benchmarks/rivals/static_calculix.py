"""Static solve by CalculiX (`ccx`), its iterative solver with incomplete Cholesky factors.

A body with `wants_field` is solved by its direct solver and answered with every point: that is
how the tests compare it.
"""

from __future__ import annotations

import re
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

# Residual over the mean force, and correction over displacement; ccx's own are 5e-3 and 1e-2.
_TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-6, , , 1e-9, , ,\n"


class Rival:
    """One run of the program a step; linear elasticity with NLGEOM is StVK."""

    tool, precision, force = "calculix", "float64", None

    def __init__(self, body: dict[str, Any]) -> None:
        program = shutil.which("ccx")
        if program is None:
            raise ImportError("ccx is not on the path")
        self._program = program
        self._wants_field = bool(body.get("wants_field", False))
        solver = "SPOOLES" if self._wants_field else "ITERATIVE CHOLESKY"
        printed = subprocess.run(
            [program, "-v"], capture_output=True, text=True, check=False
        ).stdout
        self.version = (re.findall(r"[\d.]+\d", printed) or ["?"])[0]
        rows = [
            "*NODE, NSET=ALL",
            *(f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in _numbered(body["points"])),
            "*ELEMENT, TYPE=C3D4, ELSET=BODY",
            *(f"{i}, " + ", ".join(map(str, c + 1)) for i, c in _numbered(body["cells"])),
            "*NSET, NSET=TIP",
            str(int(body["tip"]) + 1),
            "*BOUNDARY",
            *(f"{i + 1}, 1, 3" for i in body["held"].tolist()),
            "*MATERIAL, NAME=TISSUE",
            "*ELASTIC",
            f"{float(body['youngs_modulus']):.17g}, {float(body['poissons_ratio']):.17g}",
            "*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE",
            "*STEP" if str(body["strain"]) == "linear" else "*STEP, NLGEOM",
            f"*STATIC, SOLVER={solver}, DIRECT",
            "1., 1.",
            *([] if str(body["strain"]) == "linear" else [_TIGHT.strip()]),
            "*CLOAD",
        ]
        for i, force in _numbered(body["external_force"]):
            rows += [f"{i}, {j + 1}, {f:.12e}" for j, f in enumerate(force) if f != 0.0]
        rows += [f"*NODE PRINT, NSET={'ALL' if self._wants_field else 'TIP'}", "U", "*END STEP", ""]
        self._input = "\n".join(rows)

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Run it; reading its input is part of it."""
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "body.inp").write_text(self._input, encoding="utf-8")
            with Path(folder, "log").open("w", encoding="utf-8") as log:
                subprocess.run([self._program, "body"], cwd=folder, stdout=log, check=False)
            printed = Path(folder, "log").read_text(encoding="utf-8", errors="replace")
            answer = Path(folder, "body.dat").read_text(encoding="utf-8")
        numbers = [line.split() for line in answer.splitlines() if re.match(r"\s+\d+\s+\S+E", line)]
        field = np.array(numbers, dtype=float)[:, 1:]
        return {
            **({"displacement": field} if self._wants_field else {}),
            "tip_displacement": float(numbers[-1][3]),
            "iterations": max(1, len(re.findall(r"^ iteration +\d+", printed, re.MULTILINE))),
            "peak_memory_mb": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0,
            "solver": "Newton, conjugate gradients, incomplete Cholesky",
        }


def _numbered(rows: Any) -> Any:
    return enumerate(np.asarray(rows), start=1)


def prepare(body: dict[str, Any]) -> Rival:
    """Write the input file."""
    return Rival(body)
