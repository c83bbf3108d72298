"""FEBio (`febio4`): linear tetrahedra tet4 of its laws `isotropic elastic` and `neo-Hookean`.

Its isotropic elastic solid is Saint-Venant-Kirchhoff's; it knows finite strain only. The model is a
.feb file of format 4.0 in SI units: nodal loads and moved supports follow a load curve from 0 to 1,
in steps that FEBio shortens by itself, and displacements are read from a data record of the
logfile, which has twelve digits (FEBio User Manual 4, "Free Format Input" and "Logfile").

    palpate gate CASE --simulator "python febio.py {case} {result}"
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from harness import force_scale, load_parts, solve_case

# FEBio compares squares of norms of forces, but norms of displacements.
_LEFT, _LEAST, _CORRECTION, _RECORD = 1e-9, 1e-12, 1e-6, "displacements.txt"
_LAWS = {"saint-venant-kirchhoff": "isotropic elastic", "neo-hookean": "neo-Hookean"}


class Static:
    """A solve is one run of the program, which reads its model and writes every point."""

    tool, version, precision = "FEBio", "?", "float64"
    laws = tuple(_LAWS)

    def __init__(self, job: dict[str, Any]) -> None:
        program = shutil.which("febio4")
        if program is None:
            raise ImportError("febio4 is not on the path; it comes from febio.org/downloads")
        if str(job["strain"]) == "linear":
            raise ValueError("FEBio has no solid of small strain")
        self._program, self._num_points = program, len(job["points"])
        self._model = model_file(job)
        self.result: dict[str, Any] = {}

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """Run it to the full load."""
        with tempfile.TemporaryDirectory() as folder:
            model, log, record = (Path(folder, n) for n in ("body.feb", "body.log", _RECORD))
            model.write_text(self._model, encoding="utf-8")
            done = subprocess.run(
                [self._program, "-i", model.name, "-o", log.name],
                cwd=folder, capture_output=True, text=True, check=False,
            )  # fmt: skip
            text, said = (f.read_text("utf-8") if f.is_file() else "" for f in (record, log))
        displacement = last_record(text, self._num_points)
        if displacement is None or "N O R M A L   T E R M I N A T I O N" not in said:
            print(said[-2000:])
            raise SystemExit(f"febio4 ended with {done.returncode} before the full load")
        self.result = {"displacement": displacement}
        self.version = (re.findall(r"version (\d[\w.]*)", said) or ["?"])[0]
        counts = re.findall(r"Total number of equilibrium iterations[ .]*: (\d+)", said)
        iterations = {"newton_iterations": int(counts[-1])} if counts else {}
        return {"method": "Newton, its direct solver", **iterations}


def last_record(text: str, num_points: int) -> Any:
    """Displacements of all points at time 1 [m], (num_points, 3); None where they are not there.

    Each converged step adds lines *Step, *Time and *Data, and then `number,ux,uy,uz` for each node.
    """
    last = text[text.rfind("*Step") :]
    times = re.findall(r"^\*Time\s*=\s*(\S+)", last, re.MULTILINE)
    rows = [line.split(",") for line in last.splitlines() if line and not line.startswith("*")]
    if not times or abs(float(times[0]) - 1.0) > 1e-6 or len(rows) != num_points:
        return None
    numbered = np.array(sorted(rows, key=lambda row: int(row[0])), dtype=float)
    return numbered[:, 1:]


def model_file(job: dict[str, Any]) -> str:
    """The model; numbers of nodes and cells begin at 1."""
    points, fixed = job["points"], job["fixed"].astype(bool)
    moved = np.where(fixed, job["prescribed_displacement"], 0.0)
    sets: list[str] = []
    boundary: list[str] = []
    loads: list[str] = []

    def put(rows: list[str], tag: str, kind: str, nodes: Any, inner: str) -> None:
        name = f"Set{len(sets) + 1}"
        sets.append(f'<NodeSet name="{name}">{",".join(map(str, nodes + 1))}</NodeSet>')
        rows.append(f'<{tag} type="{kind}" node_set="{name}">{inner}</{tag}>')

    for at_rest, nodes in _alike(fixed & (moved == 0.0)):
        inner = "".join(f"<{a}_dof>1</{a}_dof>" for a in np.array(list("xyz"))[at_rest])
        put(boundary, "bc", "zero displacement", nodes, inner)
    for axis, name in enumerate("xyz"):
        for (value,), nodes in _alike(moved[:, axis : axis + 1]):
            inner = f'<dof>{name}</dof><value lc="1">{value:.17g}</value><relative>0</relative>'
            put(boundary, "bc", "prescribed displacement", nodes, inner)
    for force, nodes in _alike(job["external_force"]):
        put(loads, "nodal_load", "nodal_force", nodes, f'<value lc="1">{_numbers(force)}</value>')
    parts = len(load_parts(job))
    E, nu, rho = (float(job[k][0]) for k in ("youngs_modulus", "poissons_ratio", "density"))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<febio_spec version="4.0">
<Module type="solid"><units>SI</units></Module>
<Control><analysis>STATIC</analysis><plot_level>PLOT_NEVER</plot_level>
<time_steps>{parts}</time_steps><step_size>{1.0 / parts!r}</step_size>
<time_stepper type="default"><max_retries>10</max_retries><opt_iter>30</opt_iter>
<dtmin>{1e-3 / parts!r}</dtmin><dtmax>{1.0 / parts!r}</dtmax></time_stepper>
<solver type="solid"><max_refs>50</max_refs><dtol>{_CORRECTION}</dtol><etol>0</etol>
<rtol>{_LEFT**2!r}</rtol><min_residual>{(_LEAST * force_scale(job)) ** 2!r}</min_residual>
<qn_method type="BFGS"><max_ups>0</max_ups></qn_method></solver></Control>
<Material><material id="1" name="Tissue" type="{_LAWS[str(job["law"])]}">
<density>{rho!r}</density><E>{E!r}</E><v>{nu!r}</v></material></Material>
<Mesh><Nodes name="Points">
{_lines("node", map(_numbers, points))}
</Nodes><Elements type="tet4" name="Body">
{_lines("elem", (",".join(map(str, cell + 1)) for cell in job["cells"]))}
</Elements>
{chr(10).join(sets)}
</Mesh>
<MeshDomains><SolidDomain name="Body" mat="Tissue"/></MeshDomains>
<Boundary>{chr(10).join(boundary)}</Boundary>
<Loads>{chr(10).join(loads)}</Loads>
<LoadData><load_controller id="1" type="loadcurve"><interpolate>LINEAR</interpolate>
<extend>CONSTANT</extend><points><pt>0,0</pt><pt>1,1</pt></points></load_controller></LoadData>
<Output><logfile><node_data data="ux;uy;uz" delim="," file="{_RECORD}"></node_data></logfile>
</Output></febio_spec>
"""


def _alike(values: Any) -> Iterator[tuple[Any, Any]]:
    """Each row of values that is not zero, and the numbers of the points that have it."""
    found, of = np.unique(values, axis=0, return_inverse=True)
    for number, row in enumerate(found):
        if row.any():
            yield row, np.flatnonzero(of.ravel() == number)


def _numbers(values: Any) -> str:
    return ",".join(f"{value:.17g}" for value in values)


def _lines(tag: str, texts: Any) -> str:
    return "\n".join(f'<{tag} id="{k}">{text}</{tag}>' for k, text in enumerate(texts, 1))


if __name__ == "__main__":
    solve_case(Static)
