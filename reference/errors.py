"""Errors of the reference; importable without FEniCSx.

Input that cannot be used raises palpate.meshes.errors.InputError instead.
"""

from __future__ import annotations

import contextlib
import math
import re
import signal

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import made_anew


class ReferenceFailedError(RuntimeError):
    """The reference gave no result: nothing can be judged against it.

    >>> import palpate
    >>> issubclass(palpate.ReferenceFailedError, palpate.InputError)
    False
    """

    def __reduce__(self) -> tuple[object, ...]:
        return made_anew, (type(self), self.args, vars(self))


class ReferenceUnavailableError(ReferenceFailedError):
    """FEniCSx cannot be imported here.

    >>> import palpate
    >>> issubclass(palpate.ReferenceUnavailableError, palpate.ReferenceFailedError)
    True
    """


class ReferenceNotConvergedError(ReferenceFailedError):
    """No equilibrium was found under the full load.

    Attributes:
        load_factor: Largest fraction of the load for which equilibrium was found, in [0, 1).
        reason: Why the search ended.
        smallest_det_f: Smallest det F of that last equilibrium [-].
        displacement: Displacement of that last equilibrium at the mesh's points [m],
            shape (num_points, 3); empty when not even the mesh was reached.
        smallest_stretch: Smallest principal stretch there [-]; Saint-Venant-Kirchhoff reaches its
            largest resistance at about 0.577.
        position: Its position in the rest body [m], shape (3,); NaN where it was not computed.
        of: What `load_factor` is a fraction of, in words: the load, or the tools' way.
        remedy: What to do, in words.
    """

    def __init__(
        self,
        load_factor: float,
        reason: str,
        smallest_det_f: float = 1.0,
        displacement: Points | None = None,
        smallest_stretch: float = 1.0,
        position: Floats | None = None,
        *,
        is_pressed: bool = False,
    ) -> None:
        self.load_factor = load_factor
        self.of = "the tool's way" if is_pressed else "the load"
        self.remedy = "press less deep" if is_pressed else "lower the load"
        self.reason = reason
        self.smallest_det_f = smallest_det_f
        self.displacement = np.zeros((0, 3)) if displacement is None else displacement
        self.smallest_stretch = smallest_stretch
        self.position = np.full(3, np.nan) if position is None else np.asarray(position)
        where = ""
        if np.isfinite(self.position).all():
            x, y, z = self.position.tolist()
            place_text = f"({x:.4g}, {y:.4g}, {z:.4g}) m"
            where = f", smallest principal stretch {smallest_stretch:.3f} at {place_text}"
        found = f"equilibrium up to {load_factor:.3f} of {self.of} and none beyond"
        if math.isnan(load_factor):
            found = "no equilibrium near the given state"
        super().__init__(
            f"the reference found {found}: {reason} (smallest det F there "
            f"{smallest_det_f:.3g}{where})" + ("" if self.remedy in reason else f"; {self.remedy}")
        )


class ReferenceBlowUpError(ReferenceFailedError):
    """The displacements of an explicit run are no longer finite.

    `.step` is the number of accepted steps, `.time` [s] and `.displacement` [m] the last state's.
    """

    def __init__(self, step: int, time: float, displacement: Points) -> None:
        self.step = step
        self.time = time
        self.displacement = displacement
        super().__init__(
            f"the reference blew up after step {step} (t = {time:.4g} s); "
            "shorten the time step, or lower the load"
        )


class ReferenceStepError(ReferenceFailedError):
    """A time step of implicit dynamics has no solution, however short; `.reason` says why.

    `.time_step` [s] is the shortest tried, `.time` [s] and `.displacement` [m] the last state's.
    """

    def __init__(self, time: float, time_step: float, reason: str, displacement: Points) -> None:
        self.time = time
        self.time_step = time_step
        self.reason = reason
        self.displacement = displacement
        super().__init__(
            f"the reference found no step of {time_step:.3g} s beyond t = {time:.4g} s: {reason}; "
            "lower the load, or refine the mesh"
        )


class ReferenceCrashedError(ReferenceFailedError):
    """The process of the reference ended without a result.

    `.exit_code` is negative for a signal; `.stderr_tail` is the last lines of its standard error.
    """

    def __init__(self, exit_code: int, stderr_tail: str) -> None:
        self.exit_code = exit_code
        self.stderr_tail = stderr_tail
        super().__init__(f"the reference crashed ({_how(exit_code)}): {_cause(stderr_tail)}")


def _how(exit_code: int) -> str:
    if exit_code >= 0:
        return f"exit status {exit_code}"
    with contextlib.suppress(ValueError):
        name = signal.Signals(-exit_code).name
        return f"{name}, most likely out of memory" if name == "SIGKILL" else name
    return f"signal {-exit_code}"


def _cause(stderr_tail: str) -> str:
    """Return the last line that names an error, or the last line."""
    lines = [line.strip() for line in stderr_tail.splitlines() if line.strip()]
    named = [line for line in lines if re.match(r"[\w.]*(Error|Exception)\b", line)]
    return (named or lines or ["it wrote no message"])[-1]


class ReferenceTooLongError(ReferenceFailedError):
    """Runs were not started because together they would take longer than allowed.

    `.needed` is the least time of all, estimated from the first, `.budget` the time allowed [s].
    """

    def __init__(self, needed: float, budget: float) -> None:
        self.needed, self.budget = needed, budget
        super().__init__(
            f"it would take {needed:.0f} s or more, and may take {budget:g} s; coarsen the mesh, "
            "ask for fewer outputs or allow more time"
        )


class ReferenceTimeoutError(ReferenceFailedError):
    """The process of the reference was ended at its `.time_limit` [s]; `.stderr_tail` as above."""

    def __init__(self, time_limit: float, stderr_tail: str = "") -> None:
        self.time_limit = time_limit
        self.stderr_tail = stderr_tail
        super().__init__(
            f"the reference was ended after {time_limit:g} s without an answer; "
            "coarsen the mesh or raise the time limit"
        )
