"""Explicit steps of several lengths in one body: classes of cells, and when they pay.

A cell of class k is fit for steps of h b^k, b a little more than a half: it is looked at 2^k times
in a step h of the body, so that few small cells do not divide the step of all others. How such a
step is made, and why it conserves momentum: core/explicit/multirate.hpp.

Each class is stable in its own step where each of its cells is by itself (`Body.cell_time_steps`:
the largest eigenvalue of any cell bounds the body's). That bound is a half too short or more, and
the room is what stability takes where classes meet. By the spectral radius of the assembled steps,
on graded blocks of 250 to 600 cells with up to five classes, cells may be granted 1.4 times their
own steps, smoothed ones 2.2 times; 1.2 and 1.8 are used. No cell needs less than 0.9 of the
body's critical step with one class.

That is for small strains, where energy is conserved over any number of steps. Under Green strain it
creeps up without damping: a block that swings freely by 5 % of strain fails after some thousand
steps. With a mass damping of 5e-4 over a step, which takes as much of the energy in each, linear
tetrahedra swing by 10 % of strain as with one class, and fail by 15 %, where one class fails by
20 %; smoothed ones by 6 and 10 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.body import Body
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.gpu.devices import CORE
from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.meshes.tet_mesh import TetMesh

# Of the body's critical step with one class, and of the cells' own steps; see above.
PART_OF_CRITICAL = 0.9
PART_OF_OWN = {Element.LINEAR: 1.2, Element.SMOOTHED: 1.8}
MOST_CLASSES = 6
# What a tool's look at a facet costs, in cells: 52 and 70 us for 2 356 facets, where 20 724 cells
# take 282 and 1 151 us.
LOOK = {Element.LINEAR: 1.6, Element.SMOOTHED: 0.5}
# Part of the work with one class that several have to come to: they are looked after as well.
WORTH = 0.75
# Mass damping times step that keeps energy from creeping up under Green strain.
LEAST_DAMPING = 5e-4
# Steps that are tried, in classes more than one.
_TRIED = np.arange(1, 4 * MOST_CLASSES) / 4.0


@dataclass(frozen=True, eq=False)
class CellClasses:
    """Classes of the cells of a body.

    Attributes:
        of_cells: Class of each cell, from 0, shape (num_cells,); empty where there is one.
        critical_time_step: Of the whole body [s].
        counts: Cells of each class, from class 0.
    """

    of_cells: Indices
    critical_time_step: float
    counts: tuple[int, ...]

    def time_steps(self, time_step: float) -> tuple[float, ...]:
        """Step of each class [s] where the body's is as long."""
        return tuple(time_step * _core.ratio_of_classes() ** k for k in range(len(self.counts)))


def one_class(num_cells: int, critical_time_step: float) -> CellClasses:
    """All cells in one class."""
    return CellClasses(np.zeros(0, dtype=np.int32), critical_time_step, (num_cells,))


def choose_classes(
    problem: Problem,
    element: Element,
    *,
    critical: float,
    critical_with_contact: float,
    time_step: float | None,
    safety: float,
) -> CellClasses:
    """Classes for a step, or for the step with the least work.

    Args:
        problem: The body at rest.
        element: Linear tetrahedra, plain or smoothed.
        critical: Critical time step with one class [s], without contact.
        critical_with_contact: The same with the penalty of contact [s].
        time_step: Step [s] that is wanted, or None.
        safety: Fraction of the critical step that will be used.

    Raises:
        UnstableStepError: The step wanted would need more than MOST_CLASSES.
    """
    mesh = problem.mesh
    one = one_class(mesh.num_cells, critical_with_contact)
    own = PART_OF_OWN[element] * Body.of(problem).cell_time_steps()
    granted = np.maximum(own, PART_OF_CRITICAL * critical)
    shortest = PART_OF_CRITICAL * critical_with_contact
    if time_step is not None:
        if time_step <= safety * critical_with_contact:
            return one
        critical_wanted = time_step / safety
        classes = _classes(granted, shortest, critical_wanted)
        if classes.max() >= MOST_CLASSES:
            longest = shortest * _core.ratio_of_classes() ** (1 - MOST_CLASSES)
            raise UnstableStepError(time_step, safety * longest)
        return _of(classes, critical_wanted)
    facets = [len(t.contact_facets) or len(mesh.boundary_facets) for t in problem.tools]
    looks = LOOK[element] * sum(facets)
    best, least = one, WORTH * (mesh.num_cells + looks) / critical_with_contact
    for tried in shortest / _core.ratio_of_classes() ** _TRIED:
        classes = _classes(granted, shortest, tried)
        if classes.max() >= MOST_CLASSES:
            break
        looked_at = _finest_around(mesh, classes) if element is Element.SMOOTHED else classes
        work = float(np.sum(2.0**looked_at) + 2.0 ** classes.max() * looks) / tried
        if work < least:
            best, least = _of(classes, tried), work
    return best


def _of(classes: Indices, critical: float) -> CellClasses:
    return CellClasses(classes, critical, tuple(np.bincount(classes).tolist()))


def _classes(granted: Floats, shortest: float, time_step: float) -> Indices:
    """The first class of each cell that is fit for a step [s]; the last is fit for contact."""
    of_one = -np.log(_core.ratio_of_classes())
    rounding = 1e-9
    classes: Indices = (
        np.ceil(np.log(time_step / granted) / of_one - rounding).clip(0).astype(np.int32)
    )
    last = int(np.ceil(np.log(time_step / shortest) / of_one - rounding))
    if classes.max() < last:
        # What decides the step of one class is in the last, which tools are looked at with.
        classes[np.argmin(granted)] = last
    return classes


def _finest_around(mesh: TetMesh, classes: Indices) -> Indices:
    """The finest class of the cells that share a point with each: smoothed, it is looked at so."""
    at_points = np.zeros(mesh.num_points, dtype=classes.dtype)
    np.maximum.at(at_points, mesh.cells, classes[:, None])
    finest: Indices = at_points[mesh.cells].max(axis=1)
    return finest


def require_damping(mass_damping: float, time_step: float) -> None:
    """Refuse motions by Green strain that are damped too little for steps of several lengths.

    Raises:
        InputError: A mass damping [1/s] below LEAST_DAMPING over the step [s].
    """
    if mass_damping * time_step < LEAST_DAMPING:
        raise InputError(
            f"steps of several lengths (multirate) of {time_step:.3g} s need a mass damping of "
            f"{LEAST_DAMPING / time_step:.3g} 1/s or more under Green strain, or energy creeps up; "
            f"here it is {mass_damping:g} 1/s"
        )


def require_possible(
    problem: Problem,
    body: Body,
    *,
    slides: bool,
    num_threads: int,
    device: str,
    contact: ContactLaw | None,
    body_contact: ContactLaw | None,
    is_timed: bool,
) -> None:
    """Refuse what classes of cells are not built for, with the reason.

    Raises:
        InputError: There is such a thing.
    """
    law = body.law
    is_scalar = not law.is_linear_in_strain and (
        body.element is Element.SMOOTHED or law.name in ("OGDEN", "COROTATIONAL")
    )
    span = problem.time
    reasons = {
        "several threads": num_threads > 1,
        f"the device {device!r}": device != CORE,
        "a fictitious mass": not is_timed,
        "bodies that touch each other or themselves": body_contact is not None,
        "springs": bool(problem.springs),
        "supports that slide along slanted walls": slides,
        "stiffness damping": span is not None and span.stiffness_damping > 0.0,
        f"the law {law} with {body.element} tetrahedra": body.strain is Strain.GREEN and is_scalar,
        "the constraint of contact (ask for the penalty)": bool(problem.tools)
        and contact is not None
        and contact.form is ContactForm.CONSTRAINT,
        "contact at vertices (ask for facets)": any(
            tool.contact is not ContactRule.FACETS for tool in problem.tools
        ),
        "tools with friction": any(tool.friction_coefficient > 0.0 for tool in problem.tools),
        "tools that a force drives": any(tool.drive is not None for tool in problem.tools),
    }
    for reason, applies in reasons.items():
        if applies:
            raise InputError(f"steps of several lengths (multirate) do not know {reason} yet")
