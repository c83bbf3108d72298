"""Newton (Warp) as a simulator: neo-Hookean by its own choice, single precision, to rest.

    palpate gate CASE --simulator "python newton_neo_hookean.py {case} {result}"

Another law than Saint-Venant-Kirchhoff: what it differs by is the model, not the solver. Whole
points held where they are; no follower pressure, tools, time or inclusions here.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp
from relaxation import relax, stable_step

# Single precision carries no more.
TOLERANCE = 1e-3
MOST_STEPS = 40_000


def main() -> None:
    """Answer the case folder given first in the file given second."""
    case, result = Path(sys.argv[1]), Path(sys.argv[2])
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        rest = {name: stored[name] for name in stored.files}
    if given["time"] or given["tools"] or len(rest["pressure"]) or given["has_inclusions"]:
        raise SystemExit("time, tools, follower pressure and inclusions are not known here")
    is_held = rest["fixed"].astype(bool)
    if (is_held.any(axis=1) != is_held.all(axis=1)).any() or rest["prescribed_displacement"].any():
        raise SystemExit("only whole points can be held, where they are")
    wp.config.quiet = True
    wp.init()
    E, nu = given["material"]["youngs_modulus"], given["material"]["poissons_ratio"]
    mu, lmbda = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    # Its energy's derivatives at rest are 3/4 k_mu and k_lambda - 5/8 k_mu (Smith, de Goes and Kim
    # 2018): given Lamé's parameters as they are, a body bends 41 % too far even where it is stiff.
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_soft_mesh(
        pos=(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=(0.0, 0.0, 0.0),
        vertices=[tuple(map(float, p)) for p in rest["points"]],
        indices=rest["cells"].ravel().tolist(),
        density=given["material"]["density"],
        k_mu=4.0 / 3.0 * mu,
        k_lambda=lmbda + 5.0 / 6.0 * mu,
        k_damp=0.0,
        add_surface_mesh_edges=False,
    )
    free = ~is_held.all(axis=1)
    for index in np.flatnonzero(~free).tolist():
        builder.particle_mass[index] = 0.0
    model = builder.finalize(device="cpu")
    model.particle_grid = None
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    states = [model.state(), model.state()]
    control = model.control()
    dt = 0.5 * stable_step(rest, rest["lumped_mass"])
    applied = np.where(free[:, None], rest["external_force"], 0.0).astype(np.float32)
    mass = rest["lumped_mass"][free, None]
    size = float(np.linalg.norm(applied))

    def step() -> tuple[float, float]:
        now, after = states
        before = now.particle_qd.numpy()[free].copy()
        now.clear_forces()
        now.particle_f.numpy()[:] = applied
        solver.step(now, after, control, None, dt)
        states.reverse()
        speed = states[0].particle_qd.numpy()[free]
        left = float(np.linalg.norm(mass * (speed - before) / dt))
        return float((mass * speed**2).sum()), left / size

    def stop() -> None:
        states[0].particle_qd.numpy()[:] = 0.0

    step()  # compiles the kernels
    stop()
    start = time.process_time()
    num_steps, residual = relax(step, stop, TOLERANCE, MOST_STEPS)
    displacement = states[0].particle_q.numpy().astype(np.float64) - rest["points"]
    about = {
        "tool": "Newton",
        "version": f"{newton.__version__} (Warp {wp.__version__})",
        "law": "neo-Hookean",
        "method": f"time steps to rest by kinetic damping, {num_steps} steps, single precision",
        "seconds": time.process_time() - start,
        "relative_residual": residual,
    }
    key = given["case_key"]
    np.savez(result, displacement=displacement, case_key=key, about=json.dumps(about))


if __name__ == "__main__":
    main()
