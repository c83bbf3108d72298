"""How long a step of a body in explicit motion may be: springs, stiffness damping and contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.contact.body_contact import BodyContact
from palpate.fastsim.contact.contact_law import ContactLaw
from palpate.fastsim.contact.explicit_tools import ExplicitTools
from palpate.fastsim.explicit_springs import ExplicitSprings, pulling_at_once
from palpate.fastsim.springs import PatchSprings
from palpate.fastsim.viscosity import damped_time_step, stiffened_time_step
from palpate.meshes.arrays import Floats
from palpate.meshes.problem import Problem, TimeSpan


@dataclass(frozen=True)
class StepBound:
    """The longest stable step, and the contact that was made stiff enough for it.

    Attributes:
        critical_time_step: With contact and stiffness damping [s].
        tools: The rigid tools; None without any.
        body_contact: Contact of the body with itself; None where it has none.
    """

    critical_time_step: float
    tools: ExplicitTools | None
    body_contact: BodyContact | None


def critical_with_springs(body: Body, springs: ExplicitSprings, time_step: float | None) -> float:
    """The critical step of a body and its springs, without damping and contact [s].

    Args:
        body: At rest.
        springs: Of the problem.
        time_step: Chosen step [s], or None. Where all springs at once are too stiff for it, those
            count that ever pull together.
    """
    if not springs.springs:
        return body.critical_time_step()
    critical = body.critical_time_step(springs=springs.patches)
    if time_step is None or time_step <= critical:
        return critical
    return min(
        body.critical_time_step(springs=PatchSprings(body.mesh.points, together))
        for together in pulling_at_once(springs.springs)
    )


def bound_step(
    problem: Problem,
    mass: Floats,
    critical_time_step: float,
    *,
    time_step: float | None,
    stiffness_damping: float,
    contact: ContactLaw | None,
    body_contact: ContactLaw | None,
    tools: ExplicitTools | None,
) -> StepBound:
    """Bound the step by stiffness damping and contact too.

    Args:
        problem: With tools, if any.
        mass: Lumped [kg], shape (num_points,).
        critical_time_step: Of the body and its springs [s]; infinite where none is known.
        time_step: Chosen step [s], or None.
        stiffness_damping: beta [s], >= 0; see `viscosity`.
        contact: How tools are kept out; see `ExplicitTools`.
        body_contact: A penalty for bodies that touch each other or themselves, or None.
        tools: As prepared before, which then say nothing of the step; None makes them.

    Raises:
        InputError: A tool that is driven by a force, with the constraint.
    """
    touching, critical = None, critical_time_step
    is_stiffened = time_step is not None and (bool(problem.tools) or body_contact is not None)
    if time_step is not None and is_stiffened:
        critical = stiffened_time_step(critical, stiffness_damping, time_step)
    if problem.tools and tools is None:
        tools = ExplicitTools(
            problem, contact, mass, critical_time_step=critical, time_step=time_step
        )
        critical = tools.critical_time_step
    if body_contact is not None:
        touching = BodyContact(
            problem, body_contact, mass, critical_time_step=critical, time_step=time_step
        )
        critical = touching.critical_time_step
    if not is_stiffened:
        critical = damped_time_step(critical, stiffness_damping)
    return StepBound(critical, tools, touching)


def divided(span: TimeSpan, wanted: float) -> tuple[float, int]:
    """The step that is at most the wanted one and divides the outputs, and how many make one."""
    count = max(1, int(np.ceil(span.end_time / span.num_outputs / wanted * (1 - 1e-12))))
    return span.end_time / (span.num_outputs * count), count
