"""A MuJoCo flex as a simulator: Saint-Venant-Kirchhoff, brought to rest by kinetic damping.

    palpate gate CASE --simulator "python mujoco_flex.py {case} {result}"

MuJoCo solves motion, not equilibrium; the answer holds the residual that was left. Whole points
held where they are, one material; no follower pressure, tools or time here.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from relaxation import relax, stable_step

TOLERANCE = 1e-7
MOST_STEPS = 200_000


def compile_model(rest: dict[str, Any], material: dict[str, float], step: float) -> Any:
    """One slide joint for each component of each free point."""

    def text(values: Any) -> str:
        return " ".join(f"{v:.17g}" for v in np.ravel(values))

    held = np.flatnonzero(rest["fixed"].all(axis=1))
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <option timestep="{step:.17g}" gravity="0 0 0">
          <flag contact="disable" constraint="disable" energy="disable"/></option>
        <size memory="2G"/>
        <worldbody><flexcomp name="body" type="direct" dim="3" radius="1e-6"
            mass="{float(rest["lumped_mass"].sum()):.17g}"
            point="{text(rest["points"])}" element="{" ".join(map(str, rest["cells"].ravel()))}">
          <elasticity young="{material["youngs_modulus"]:.17g}"
            poisson="{material["poissons_ratio"]:.17g}" damping="0"/>
          <contact selfcollide="none" contype="0" conaffinity="0"/>
          <pin id="{" ".join(map(str, held))}"/>
        </flexcomp></worldbody></mujoco>"""
    )


def main() -> None:
    """Answer the case folder given first in the file given second."""
    case, result = Path(sys.argv[1]).absolute(), Path(sys.argv[2]).absolute()
    os.chdir(result.parent)  # it writes a log into the working folder
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        rest = {name: stored[name] for name in stored.files}
    if given["time"] or given["tools"] or len(rest["pressure"]) or given["has_inclusions"]:
        raise SystemExit("time, tools, follower pressure and inclusions are not known here")
    if given["strain"] == "linear":
        raise SystemExit("a flex knows Green strain only")
    is_held = rest["fixed"].astype(bool)
    if (is_held.any(axis=1) != is_held.all(axis=1)).any() or rest["prescribed_displacement"].any():
        raise SystemExit("only whole points can be held, where they are")
    num_points = len(rest["points"])
    # A flex spreads its mass evenly over its points.
    mass = np.full(num_points, rest["lumped_mass"].sum() / num_points)
    model = compile_model(rest, given["material"], stable_step(rest, mass))
    data = mujoco.MjData(model)
    free = ~is_held.all(axis=1)
    applied = rest["external_force"][free].ravel()
    data.qfrc_applied[:] = applied
    size = float(np.linalg.norm(applied))
    start = time.process_time()

    def step() -> tuple[float, float]:
        mujoco.mj_step(model, data)
        left = float(np.linalg.norm(data.qfrc_passive + data.qfrc_applied))
        return float(data.qvel @ data.qvel), left / size

    def stop() -> None:
        data.qvel[:] = 0.0

    num_steps, residual = relax(step, stop, TOLERANCE, MOST_STEPS)
    displacement = np.zeros_like(rest["points"])
    displacement[free] = np.array(data.qpos).reshape(-1, 3)
    about = {
        "tool": "MuJoCo flex",
        "version": mujoco.__version__,
        "law": "Saint-Venant-Kirchhoff",
        "method": f"time steps to rest by kinetic damping, {num_steps} steps",
        "seconds": time.process_time() - start,
        "relative_residual": residual,
    }
    key = given["case_key"]
    np.savez(result, displacement=displacement, case_key=key, about=json.dumps(about))


if __name__ == "__main__":
    main()
