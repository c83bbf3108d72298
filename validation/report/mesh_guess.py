"""What a mesh misses of the displacement, guessed by cutting each cell in eight.

The rule of `bending_rule` knows bending alone. Compression, shear, near incompressibility and the
edges of what is held cost as much, and do not show in the thickness. So linear strain is solved
with smoothed tetrahedra on the case's mesh and on the mesh cut in eight. If the error falls as
h^1.5 (h^2 where the answer is smooth, about h at clamped edges), the converged displacement is

    u = u_fine + (u_fine - u_coarse) / (2^1.5 - 1)

(L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357); both elements are held against it.

Guesses for the built-in static cases are 0.7 to 2.5 times what smoothed tetrahedra are off under
Green strain: too small at edges that are held, too large where large strains stiffen the body.
What flat facets leave out of a curved surface is in neither mesh, and so in no guess.
"""

from __future__ import annotations

from palpate.meshes.field_norms import l2_norm
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.refinement import refine_problem
from palpate.validation.solving import solve
from palpate.validation.states import CandidateFailedError

ORDER = 1.5
# Cut in eight some three seconds; more cells are not worth the wait.
MOST_CELLS = 10_000


def guess_errors(problem: Problem) -> dict[Element, float] | None:
    """Part of the displacement that each element misses, relative L2 over the mesh's points [-].

    Args:
        problem: Statics without tools, which linear solves know nothing of.

    Returns:
        None where there is no guess: a motion, a tool, more than `MOST_CELLS` cells, nothing that
        moves, or no answer with linear strain.
    """
    mesh = problem.mesh
    if problem.time is not None or problem.tools or mesh.num_cells > MOST_CELLS:
        return None
    both = (problem, refine_problem(problem))
    try:
        coarse, fine = (
            solve(each, strain=Strain.LINEAR, element=Element.SMOOTHED).displacement
            for each in both
        )
        linear = solve(problem, strain=Strain.LINEAR).displacement
    except CandidateFailedError:
        return None
    # The given points come first.
    fine = fine[: mesh.num_points]
    converged = fine + (fine - coarse) / (2.0**ORDER - 1.0)
    size = l2_norm(mesh, converged)
    if size == 0.0:
        return None
    answers = {Element.LINEAR: linear, Element.SMOOTHED: coarse}
    return {who: l2_norm(mesh, found - converged) / size for who, found in answers.items()}


def edge_that_would_do(error: float, limit: float) -> float:
    """Length of edges for an error within the limit, over that of now [-], by the same rate."""
    return float((limit / error) ** (1.0 / ORDER))
