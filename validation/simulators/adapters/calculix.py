"""CalculiX (`ccx`) as a simulator: linear tetrahedra C3D4, NLGEOM makes its linear law StVK.

    palpate gate CASE --simulator "python calculix.py {case} {result}"

Its answer has seven digits (a text file). Follower pressure, tools, time and cells of different
materials are not handed to it here.
"""

from __future__ import annotations

import json
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

# Residual over the mean force, and correction over displacement; ccx's own are 5e-3 and 1e-2.
_TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-6, , , 1e-9, , ,"


def input_deck(rest: dict[str, Any], material: dict[str, float], is_linear: bool) -> str:
    """The input file; numbers count from one."""
    rows = ["*NODE, NSET=ALL"]
    rows += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(rest["points"], 1)]
    rows += ["*ELEMENT, TYPE=C3D4, ELSET=BODY"]
    rows += [f"{i}, " + ", ".join(map(str, c + 1)) for i, c in enumerate(rest["cells"], 1)]
    rows += ["*MATERIAL, NAME=TISSUE", "*ELASTIC"]
    rows += [f"{material['youngs_modulus']:.15g}, {material['poissons_ratio']:.15g}"]
    rows += ["*SOLID SECTION, ELSET=BODY, MATERIAL=TISSUE"]
    rows += ["*STEP, INC=1000" if is_linear else "*STEP, NLGEOM, INC=1000", "*STATIC"]
    rows += ["1., 1." if is_linear else "0.25, 1., 1e-4, 1."]
    rows += [] if is_linear else [_TIGHT]
    rows += ["*BOUNDARY"]
    for point, axis in zip(*np.nonzero(rest["fixed"]), strict=True):
        moved = rest["prescribed_displacement"][point, axis]
        rows.append(f"{point + 1}, {axis + 1}, {axis + 1}, {moved:.12e}")
    rows += ["*CLOAD"]
    for point, axis in zip(*np.nonzero(rest["external_force"]), strict=True):
        rows.append(f"{point + 1}, {axis + 1}, {rest['external_force'][point, axis]:.12e}")
    return "\n".join([*rows, "*NODE PRINT, NSET=ALL", "U", "*END STEP", ""])


def main() -> None:
    """Answer the case folder given first in the file given second."""
    case, result = Path(sys.argv[1]), Path(sys.argv[2])
    program = shutil.which("ccx")
    if program is None:
        raise SystemExit("ccx is not on the path")
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        rest = {name: stored[name] for name in stored.files}
    if given["time"] or given["tools"] or len(rest["pressure"]) or given["has_inclusions"]:
        raise SystemExit("time, tools, follower pressure and inclusions are not known here")
    printed = subprocess.run([program, "-v"], capture_output=True, text=True, check=False).stdout
    with tempfile.TemporaryDirectory() as folder:
        deck = input_deck(rest, given["material"], given["strain"] == "linear")
        Path(folder, "body.inp").write_text(deck, encoding="utf-8")
        done = subprocess.run([program, "body"], cwd=folder, capture_output=True, check=False)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        table = Path(folder, "body.dat")
        text = table.read_text(encoding="utf-8") if table.is_file() else ""
    last = text[text.rfind("displacements") :]
    rows = [line.split() for line in last.splitlines() if re.match(r"\s+\d+\s+\S+E", line)]
    if done.returncode or len(rows) != len(rest["points"]) or "time  0.1000000E+01" not in last:
        raise SystemExit(f"ccx ended with {done.returncode} before the full load")
    displacement = np.zeros_like(rest["points"])
    for number, *values in rows:
        displacement[int(number) - 1] = [float(v) for v in values]
    about = {
        "tool": "CalculiX",
        "version": (re.findall(r"[\d.]+\d", printed) or ["?"])[0],
        "law": "linear elasticity" if given["strain"] == "linear" else "Saint-Venant-Kirchhoff",
        "method": "Newton, direct solver",
        "seconds": used.ru_utime + used.ru_stime,
    }
    key = given["case_key"]
    np.savez(result, displacement=displacement, case_key=key, about=json.dumps(about))


if __name__ == "__main__":
    main()
