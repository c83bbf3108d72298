"""The steps that a problem states for its motion."""

from __future__ import annotations

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem, TimeSpan


def stated_steps(problem: Problem, method: str) -> tuple[TimeSpan, float, int]:
    """Time span, time step [s], and whole steps from one output to the next.

    Args:
        problem: With a time span and its time step.
        method: Who needs them, for the message.

    Raises:
        InputError: No time step, or outputs that are not whole steps apart.
    """
    span = problem.time
    if span is None or span.time_step is None:
        raise InputError(f"{method} needs a time span with its time_step given")
    dt = span.time_step
    per_output = round(span.end_time / span.num_outputs / dt)
    if per_output < 1 or abs(per_output * dt * span.num_outputs - span.end_time) > 1e-9 * dt:
        raise InputError(
            f"{span.num_outputs} outputs to {span.end_time:g} s are not whole steps of {dt:g} s "
            "apart; choose end_time as num_outputs times a multiple of time_step"
        )
    return span, dt, per_output
