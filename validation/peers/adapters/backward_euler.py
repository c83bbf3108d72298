"""What position-based and block-descent simulators share: a case in motion, by backward Euler.

A step from u with velocity v minimises, over the displacement u+ at its end,

    w/2 |u+ - y|^2 + W(u+),   w = (1 + lambda dt) m / dt^2,   y = u + (m v / dt + F) / w

with lumped masses m, mass damping lambda and dead loads F; then v+ = (u+ - u) / dt.
Points held where they are; no tools, follower pressure or amplitudes here.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mechanics import rest_shape

LAWS = ("saint-venant-kirchhoff", "neo-hookean-stable")


class Body:
    """The arrays of a case: `points`, `cells`, `gradients` of all four shape functions, ..."""

    def __init__(self, given: dict[str, Any], arrays: dict[str, Any]) -> None:
        self.law = given["material"].get("law", LAWS[0])
        loads = [load["amplitude"] for load in given["loads"]]
        if (
            given["strain"] != "green" or self.law not in LAWS or not given["time"] or any(loads)
            or given["tools"] or given["springs"] or len(arrays["pressure"])
            or arrays["prescribed_displacement"].any()
            or "sliding_normals" in arrays or given["time"].get("stiffness_damping")
        ):  # fmt: skip
            raise SystemExit(
                f"only motions of {' or '.join(LAWS)} under dead, steady loads here, without "
                "stiffness damping"
            )
        self.points, self.cells = arrays["points"], arrays["cells"]
        inner, self.volumes = rest_shape({"points": self.points, "cells": self.cells})
        self.gradients = np.concatenate([-inner.sum(axis=1)[:, None], inner], axis=1)
        E, nu = arrays["youngs_modulus"], arrays["poissons_ratio"]
        self.lmbda, self.mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        self.is_free = arrays["fixed"] == 0
        self.mass, self.force = arrays["lumped_mass"][:, None], arrays["external_force"]
        self.damping = given["time"]["mass_damping"]
        self.start = arrays.get("initial_velocity", np.zeros_like(self.points))

    def deformation_gradients(self, u: Any, cells: Any) -> Any:
        """F of some cells, (n, 3, 3)."""
        return np.eye(3) + np.einsum("cai,caj->cij", u[self.cells[cells]], self.gradients[cells])

    def colours(self, neighbours: list[Any], count: int) -> list[Any]:
        """Items in groups of which none has a neighbour in its own, first come, first served."""
        of: list[int] = []
        for item in range(count):
            taken = {of[other] for other in neighbours[item] if other < item}
            of.append(next(k for k in range(count) if k not in taken))
        return [np.flatnonzero(np.array(of) == k) for k in range(max(of) + 1)]


def answer(
    name: str,
    improver: Callable[[Body], Callable[[Any, Any, Any], None]],
    *,
    starts_at_y: bool = True,
) -> None:
    """Answer the case folder given first in the file given second, with iterations given third.

    Args:
        name: Of the method.
        improver: Makes of a body what improves u+ once, in place, from u+, y and w.
        starts_at_y: Whether the first u+ is y, or the last step's.
    """
    case, result = Path(sys.argv[1]), Path(sys.argv[2])
    iterations = int(sys.argv[3]) if len(sys.argv) > 3 else 20
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    with np.load(case / "rest.npz") as stored:
        body = Body(given, {key: stored[key] for key in stored.files})
    span, began = given["time"], time.process_time()
    if span["time_step"] is None:
        raise SystemExit("the case states no time_step")
    dt, outputs = span["time_step"], span["output_times"]
    per_output = round(outputs[1] / dt)
    improve = improver(body)
    u, v = np.zeros_like(body.points), np.where(body.is_free, body.start, 0.0)
    states = [u]
    w = (1.0 + body.damping * dt) * body.mass / dt**2
    for step in range(per_output * (len(outputs) - 1)):
        y = u + np.where(body.is_free, (body.mass * v / dt + body.force) / w, 0.0)
        new = y.copy() if starts_at_y else u.copy()
        for _ in range(iterations):
            improve(new, y, w)
        u, v = new, (new - u) / dt
        if not np.isfinite(u).all():
            raise SystemExit(f"no finite number after step {step + 1}")
        if (step + 1) % per_output == 0:
            states.append(u)
    about = {
        "tool": name, "version": np.__version__, "law": body.law, "integrator": "backward-euler",
        "time_step": dt, "iterations": iterations, "seconds": time.process_time() - began,
    }  # fmt: skip
    np.savez(
        result, displacement=np.array(states), times=outputs, case_key=given["case_key"],
        about=json.dumps(about),
    )  # fmt: skip
