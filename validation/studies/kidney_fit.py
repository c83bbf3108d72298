"""How Poisson's ratio and the force of the kidney case were fitted, once.

Table I of Yan, Gu et al. 2007 gives volumes (+9.51 % linear, +5.92 % Green) but neither mesh,
force, Young's modulus nor Poisson's ratio. With a clamped lower half and a pulled top, those two
numbers follow from the two volumes; Young's modulus only scales the force. Calibration, not
validation: the surface areas are what is predicted.

    python -m palpate.validation.studies.kidney_fit

prints the fitted values; they are kept in cases/kidney.toml.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.case import Case, load_case
from palpate.validation.references.sets import solve_state

# Percentage points; the paper prints volumes to 1 mm3.
TARGET = np.array([(364543 / 332889 - 1) * 100, (352602 / 332889 - 1) * 100])
TOLERANCE = 0.005


def with_parameters(case: Case, poissons_ratio: float, force_scale: float) -> Problem:
    """The case's problem with another Poisson's ratio and its force multiplied."""
    spec = case.spec
    material = spec.material.model_copy(update={"poissons_ratio": poissons_ratio})
    force = spec.load[0]
    if force.kind != "force":
        raise ValueError("the first load of the case must be the fitted force")
    scaled = tuple(force_scale * f for f in force.force)
    load = (force.model_copy(update={"force": scaled}), *spec.load[1:])
    changed = spec.model_copy(update={"material": material, "load": load})
    return Case(case.path, changed, case.text).problem


def growth(
    problem: Problem, progress: Callable[[str], None]
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Growth of volume by P2, linear and Green [%]."""
    values = []
    for strain in Strain:
        state = solve_state(problem, strain, 2, progress)
        values.append((state.volume / problem.mesh.volume - 1.0) * 100.0)
    return np.array(values)


def fit(case: Case, progress: Callable[[str], None]) -> tuple[float, float]:
    """Newton's method: derivatives on the case's mesh, residuals on that mesh cut in eight."""
    x = np.array([case.spec.material.poissons_ratio, 1.0])
    steps = np.array([0.005, 0.01])
    for _ in range(8):
        error = growth(refine_problem(with_parameters(case, x[0], x[1])), progress) - TARGET
        print(
            f"poissons_ratio {x[0]:.6f}, force times {x[1]:.6f}: error {error} points", flush=True
        )
        if np.abs(error).max() < TOLERANCE:
            break
        base = growth(with_parameters(case, x[0], x[1]), progress)
        columns = []
        for k in range(2):
            moved = x.copy()
            moved[k] += steps[k]
            columns.append(
                (growth(with_parameters(case, moved[0], moved[1]), progress) - base) / steps[k]
            )
        x = x - np.linalg.solve(np.array(columns).T, error)
    return float(x[0]), float(x[1])


if __name__ == "__main__":
    ratio, scale = fit(load_case("kidney"), lambda _line: None)
    print(f"poissons_ratio = {ratio:.6f}; multiply the force by {scale:.6f}")
