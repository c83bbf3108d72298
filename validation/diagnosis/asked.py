"""Isotropy, by asking the candidate again: the same problem turned must give the answer turned.

Named only where the same problem renumbered, and an affine motion of all of the boundary, are
answered right: what is wrong then depends on how the axes lie and on nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from palpate.meshes import transforms
from palpate.meshes.arrays import Points
from palpate.meshes.problem import Problem
from palpate.validation.diagnosis.explanation import OF_RELATION, Cause, Explanation

Ask = Callable[[Problem], Points]
_AXIS = (1.0, 2.0, -0.5)
_ANGLE_DEG = 70.0
# What solvers leave of a relation: one that is kept better says no more.
_NOISE = 1e-9
_SLOPE = np.array([[0.01, 0.005, 0.0], [-0.004, -0.008, 0.01], [0.0, 0.006, 0.005]])


def isotropy_explanation(problem: Problem, answer: Points, ask: Ask) -> Iterator[Explanation]:
    """Whether the answer depends on how the body lies in space.

    Args:
        problem: A static one; supports of single components cannot be turned, and are not tried.
        answer: The candidate's displacement [m].
        ask: Its displacement of another problem; may raise CandidateFailedError.
    """
    if not all(all(support.components) for support in problem.supports):
        return
    scale = float(np.abs(answer).max())
    if scale == 0.0:
        return
    mesh = problem.mesh
    outer = np.unique(mesh.boundary_facets)
    affine = mesh.points @ _SLOPE
    patch = transforms.prescribe(mesh, problem.material, outer, affine)
    # The patch has no inclusions: nor may the body have, for it to be told apart.
    kept = float(np.abs(ask(patch) - affine).max() / np.abs(affine).max())
    given, back = transforms.renumber(problem)
    kept = max(kept, float(np.abs(back(ask(given)) - answer).max()) / scale)
    given, back = transforms.turn(problem, transforms.rotation(_AXIS, _ANGLE_DEG))
    broken = float(np.abs(back(ask(given)) - answer).max()) / scale
    yield turned_otherwise(kept, broken)


def turned_otherwise(kept: float, broken: float) -> Explanation:
    """What relations say of isotropy.

    Args:
        kept: The most that any relation is off which a law that is not isotropic keeps.
        broken: How far the answer to the turned problem is from the answer turned.
    """
    name = (
        "the law is not isotropic, or axes are mixed up: the turned problem has another answer "
        f"than the turned one, by {broken:.2g}"
    )
    return Explanation(name, Cause.LAW, max(kept, _NOISE), broken, OF_RELATION, 4)
