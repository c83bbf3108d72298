"""The equations that a result is judged by, and what it states of its own.

The case says what they are, or the caller, who may ask for another scheme, step, element, law,
precision or contact. A result chooses nothing: what it states in `about` is shown, and compared
with what was asked; a difference is a failed check. What it states under other names, or in words
that no option knows, is shown alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.reference.schemes import Integrator, Steps, stated_steps
from palpate.validation.exchange.case_folder import describe_conventions
from palpate.validation.quoting import in_quotes
from palpate.validation.states import Precision, State

# Time limit of a simulator, and of the reference that is stepped as it was asked to [s].
TIME_LIMIT = 600.0
# No step of the reference takes less [s]: measured are 3e-4 with 18 cells.
LEAST_SECONDS_OF_A_STEP = 5e-5
# Relative: a step that was written with six digits is the same one.
_DIGITS = 1e-5
_PRECISIONS = {"float32": Precision.SINGLE, "float64": Precision.DOUBLE}
_PRECISIONS |= {precision.value: precision for precision in Precision}
_LINEAR = "linear elasticity"


@dataclass(frozen=True)
class AskedSteps:
    """Scheme and step that the caller asks for instead of the case's.

    Args:
        integrator: The scheme; None is the case's central differences.
        time_step: [s]; None is the case's.
        time_limit: Of the reference that takes these steps [s].

    Raises:
        InputError: The step is not above 0.
    """

    integrator: Integrator | None = None
    time_step: float | None = None
    time_limit: float = TIME_LIMIT

    def __post_init__(self) -> None:
        step = self.time_step
        if step is not None and not 0.0 < step < math.inf:
            raise InputError(f"--time-step {step:g}: needs a finite value above 0")

    @property
    def scheme(self) -> Integrator:
        """The scheme."""
        return self.integrator or Integrator.CENTRAL_DIFFERENCES

    def stepped(self, problem: Problem) -> Problem:
        """The problem with the time step that is asked for.

        Raises:
            InputError: A step for a case without [time], one that is longer than it, or one that
                its outputs are not whole numbers of apart where there are tools: their forces are
                means from output to output, and nothing is read between those.
        """
        step = self.time_step
        if step is None:
            return problem
        given = Steps(self.scheme, step).of(problem)
        assert given.time is not None
        if step > given.time.end_time:
            raise InputError(
                f"--time-step {step:g} s is longer than the motion, {given.time.end_time:g} s: "
                "take shorter steps"
            )
        if given.tools:
            stated_steps(given, f"--time-step {step:g}")
        return given

    def of(self, problem: Problem) -> Steps | None:
        """The steps that are asked for; None where they are the case's, and where it has none."""
        span = problem.time
        step = None if span is None else self.time_step or span.time_step
        if span is None or step is None:
            return None
        steps = Steps(self.scheme, step)
        own = step if span.time_step is None else span.time_step
        return None if steps == Steps(Integrator.CENTRAL_DIFFERENCES, own) else steps

    def require_affordable(self, problem: Problem) -> None:
        """Refuse steps that the reference cannot take within the time limit.

        Raises:
            InputError: They are too many; or see `stepped`.
        """
        span = self.stepped(problem).time
        if self.of(problem) is None or span is None or span.time_step is None:
            return
        count = span.end_time / span.time_step
        if count * LEAST_SECONDS_OF_A_STEP > self.time_limit:
            raise InputError(
                f"--time-step {span.time_step:g}: {count:.3g} steps to {span.end_time:g} s, and "
                f"the reference takes at least {LEAST_SECONDS_OF_A_STEP:g} s for each: more than "
                f"the time limit of {self.time_limit:g} s. Take longer steps, or a longer "
                "--time-limit"
            )


@dataclass(frozen=True)
class Difference:
    """What a result states, what was asked instead, and the option that would ask for it."""

    stated: str
    asked: str
    option: str


def differences(
    problem: Problem,
    state: State,
    *,
    element: Element,
    steps: AskedSteps,
    is_stepped: bool,
    precision: Precision,
) -> list[Difference]:
    """What a result states otherwise than it was asked; what it does not state is no difference.

    Args:
        problem: The case's.
        state: The result; its strain measure is what it was asked for.
        element: The element that was asked for.
        steps: The scheme and step that were asked for.
        is_stepped: Whether checks of the case are about the case's own steps.
        precision: The precision that was granted; double is no difference where single was.
    """
    says = state.says
    found = list(_of_element(says.get("element", state.element.value), element))
    if problem.time is not None:
        found += _of_steps(says, problem, steps, is_stepped=is_stepped)
    found += _of_law(says.get("law"), problem, state.strain)
    stated = _word(_PRECISIONS, says.get("precision"))
    if stated is Precision.SINGLE and precision is Precision.DOUBLE:
        found.append(Difference("single precision", "double precision", "--precision single"))
    rules = {tool.contact for tool in problem.tools}
    rule = _word({rule.value: rule for rule in ContactRule}, says.get("contact"))
    if rule is not None and rules and rules != {rule}:
        asked = " and ".join(sorted(rules))
        found.append(Difference(f"contact at {rule}", f"at {asked}", f"--contact {rule}"))
    return found


def in_words(found: list[Difference]) -> str:
    """Differences as a sentence, with what to do next."""
    stated, asked = (", ".join(getattr(each, of) for each in found) for of in ("stated", "asked"))
    options = " ".join(each.option for each in found if each.option)
    remedy = f"ask for it with {options}, or correct" if options else "correct"
    return f"the result states {stated}; asked was {asked}: {remedy} the simulator"


def steps_of_result(problem: Problem, says: Mapping[str, Any], asked: AskedSteps) -> Steps | None:
    """Scheme and time step of a motion as its result states them, or as they were asked for.

    None in statics, and where nobody says so, or it cannot be read.
    """
    span = problem.time
    named = says.get("integrator", asked.integrator)
    if span is None or (named is None and asked.time_step is None):
        return None
    step = _number(says.get("time_step", asked.time_step or span.time_step))
    scheme = _word({each.value: each for each in Integrator}, named or asked.scheme)
    return None if step is None or scheme is None else Steps(scheme, step)


def _word(known: Mapping[str, Any], stated: object) -> Any:
    """What a word stands for; None where it is no known one."""
    return known.get(stated.strip().lower()) if isinstance(stated, str) else None


def _of_element(stated: object, asked: Element) -> Iterator[Difference]:
    found = _word({each.value: each for each in Element}, stated)
    if found is not None and found is not asked:
        yield Difference(f"{found} tetrahedra", str(asked), f"--element {found}")


def _of_steps(
    says: Mapping[str, Any], problem: Problem, asked: AskedSteps, *, is_stepped: bool
) -> Iterator[Difference]:
    assert problem.time is not None
    named, stated = says.get("integrator"), says.get("time_step")
    if named is not None and (is_stepped or asked.integrator is not None):
        known = _word({each.value: each for each in Integrator}, named)
        if known is not asked.scheme:
            option = "" if known is None else f"--integrator {known}"
            yield Difference(known or in_quotes(str(named)), asked.scheme, option)
    wanted = asked.time_step or (problem.time.time_step if is_stepped else None)
    if stated is None or wanted is None:
        return
    step = _number(stated)
    if step is None:
        yield Difference(f"a time step of {in_quotes(str(stated))}", f"{wanted:g} s", "")
    elif not abs(step - wanted) <= _DIGITS * wanted:
        option = f"--time-step {step!r}"  # every digit
        yield Difference(f"steps of {step:g} s", f"steps of {wanted:g} s", option)


def _number(stated: object) -> float | None:
    """A finite number above 0; None where it is none."""
    number = float(stated) if isinstance(stated, int | float) else math.nan
    return number if 0.0 < number < math.inf else None


@cache
def _laws() -> dict[str, str]:
    """Laws by the names that a result may state: options of `--law`, and case.json's own words."""
    texts = {law.value: describe_conventions(Strain.GREEN, law)["law"] for law in Law}
    texts[_LINEAR] = describe_conventions(Strain.LINEAR)["law"]
    names = {_plain(law): law for law in texts}
    for law, text in texts.items():
        for name in (text, text.partition(":")[0]):
            names.setdefault(_plain(name), law)
    return names


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def _of_law(stated: object, problem: Problem, strain: Strain) -> Iterator[Difference]:
    own = problem.material.law.value
    found = _laws().get(_plain(stated)) if isinstance(stated, str) else None
    asked = _LINEAR if strain is Strain.LINEAR else own
    # A case of linear strain names its law too.
    if found is not None and found not in (asked, own):
        yield Difference(found, asked, "" if _LINEAR in (found, asked) else f"--law {found}")
