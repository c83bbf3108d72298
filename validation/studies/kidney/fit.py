"""How Poisson's ratio and the force of the kidney case were fitted, once.

Table I of Yan, Gu et al. 2007 gives volumes (+9.51 % linear, +5.92 % Green) but neither mesh,
force, Young's modulus nor Poisson's ratio. With a clamped lower half and a pulled top, those two
numbers follow from the two volumes; Young's modulus only scales the force. Calibration, not
validation: the surface areas are what is predicted.

    python -m palpate.validation.studies.kidney.fit

prints by how much to multiply the values in cases/kidney.toml.
"""

from __future__ import annotations

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.case import load_case
from palpate.validation.references.sets import solve_state
from palpate.validation.states import in_silence
from palpate.validation.studies.bodies import changed

# Percentage points; the paper prints volumes to 1 mm3.
TARGET = np.array([(364543 / 332889 - 1) * 100, (352602 / 332889 - 1) * 100])
TOLERANCE = 0.005
_STEPS = np.array([0.017, 0.01])


def growth(problem: Problem, factors: Points, *, is_refined: bool = False) -> Points:
    """Growth of volume by P2, linear and Green [%], with (Poisson's ratio, load) multiplied."""
    given = changed(changed(problem, "Poisson's ratio", factors[0]), "load", factors[1])
    given = refine_problem(given) if is_refined else given
    volumes = [solve_state(given, strain, 2, in_silence).volume for strain in Strain]
    return (np.array(volumes) / given.mesh.volume - 1.0) * 100.0


def fit(problem: Problem) -> Points:
    """Newton's method: derivatives on the case's mesh, residuals on that mesh cut in eight."""
    factors = np.ones(2)
    for _ in range(8):
        error = growth(problem, factors, is_refined=True) - TARGET
        print(f"factors {factors}: error {error} points", flush=True)
        if np.abs(error).max() < TOLERANCE:
            break
        base = growth(problem, factors)
        slopes = [(growth(problem, factors + s) - base) / s.sum() for s in np.diag(_STEPS)]
        factors = factors - np.linalg.solve(np.array(slopes).T, error)
    return factors


if __name__ == "__main__":
    case = load_case("kidney").problem
    ratio, scale = fit(case)
    print(f"poissons_ratio = {ratio * case.material.poissons_ratio:.6f}; force times {scale:.6f}")
