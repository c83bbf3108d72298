"""What an explanation is, the rule by which one is named, and how factors are said. Plain data.

An explanation is one mistake that a simulator may have made. Undone, it leaves a residual: of the
result against the reference, or of the altered equations at the points that are free. It is named
only where that residual is at most `DOUBLE` of its scale (`SINGLE` where numbers of single
precision can do no better) and at least `FAR_BETTER` times smaller than that of the problem as it
was stated, measured the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction
from palpate.meshes.problem import Element, Strain

# Residual that solvers of double precision leave once converged, with room for loose ones.
DOUBLE = 1e-6
# Single precision: 6e-8, times the thousand that forces of a body that bends easily lose.
SINGLE = 1e-4
FAR_BETTER = 1e3
# Two results of converged solvers: residuals of 1e-10, and what a soft body makes of them.
CONVERGED = 1e-8
# Fits this close to nothing are as good as each other.
_AS_GOOD = 1e-9
# Rounding: nothing has to be explained below this residual of the problem as stated.
_TINY = 1e-15

OF_DISPLACEMENT = "the reference's largest displacement"
OF_FORCE = "the largest nodal force"
OF_MOTION = "the largest displacement of the motion's start"
OF_TOOL_FORCE = "the reference's largest force on a tool"
OF_RELATION = "the largest displacement"


class Cause(StrEnum):
    """The part of a simulation in which the mistake was made."""

    AGREES = "none: the stated problem is solved"
    PRECISION = "precision"
    RESULT = "answer"
    UNITS = "units"
    LAW = "law"
    MATERIAL = "material"
    LOAD = "load"
    SUPPORT = "support"
    TOOL = "tool"
    MASS = "mass"
    TIME = "time"


@dataclass(frozen=True)
class Explanation:
    """One mistake in words, the part of the simulation where it was made, and what undoing leaves.

    `residual` is that, `stated` what the problem as stated leaves, both in parts of `of`;
    `complexity` is 0 for the stated problem itself, 1 for a plain mistake, more for fitted numbers;
    `limit` what the residual may be at most: `SINGLE`, or what another mesh is off.
    """

    name: str
    cause: Cause
    residual: float
    stated: float
    of: str
    complexity: int = 1
    limit: float = SINGLE

    @property
    def fits(self) -> bool:
        """Whether it may be named."""
        if not math.isfinite(self.residual) or self.residual > self.limit:
            return False
        return self.complexity == 0 or FAR_BETTER * max(self.residual, _TINY) <= self.stated

    @property
    def is_single(self) -> bool:
        """Whether it fits to single precision only."""
        return self.residual > DOUBLE


@dataclass(frozen=True)
class Diagnosis:
    """What explains one result of a candidate, by its strain measure and element.

    `explanations` are those that fit of so many `tested`, the simplest first; `stated` is what the
    result as it stands leaves, in parts of `of`; `hint` says where the stated equations fail, or
    what could not be tried.
    """

    strain: Strain
    explanations: tuple[Explanation, ...]
    tested: int
    stated: float
    of: str
    hint: str = ""
    element: Element = Element.LINEAR

    @property
    def title(self) -> str:
        """Which result it is about, for people."""
        plain = f"{self.strain} strain"
        return plain if self.element is Element.LINEAR else f"{plain}, {self.element}"

    @property
    def first(self) -> Explanation | None:
        """The simplest that fits."""
        return self.explanations[0] if self.explanations else None

    def __str__(self) -> str:
        """One line for people."""
        best, *others = self.explanations or (None,)
        if best is None:
            line = (
                f"none of {self.tested} explanations fits" if self.tested else "nothing was tried"
            )
        elif best.complexity == 0:
            line = f"{best.name} ({best.residual:.1g} of {best.of})"
        else:
            line = (
                f"fits '{best.name}' to {best.residual:.1g} of {best.of}; as stated, "
                f"{best.stated:.2g} is left"
            )
            if best.is_single:
                line += f" ({'to single precision' if best.limit == SINGLE else 'meshes differ'})"
        shown = [f"'{other.name}'" for other in others[:3]]
        if shown:
            more = f" and {len(others) - 3} more" if len(others) > 3 else ""
            line += f"; {', '.join(shown)}{more} fit as well: this case cannot tell them apart"
        return line + (f". {self.hint}" if self.hint else "")


def choose(tried: Iterable[Explanation]) -> tuple[Explanation, ...]:
    """Those that fit, simplest first; without those that fit far worse than the best."""
    fitting = [each for each in tried if each.fits]
    # The result is said to agree only where nothing is found to be wrong with it.
    fitting = [each for each in fitting if each.complexity > 0] or fitting
    if not fitting:
        return ()
    best = min(each.residual for each in fitting)
    closest = [each for each in fitting if each.residual <= max(FAR_BETTER * best, _AS_GOOD)]
    unique: dict[str, Explanation] = {}
    for each in closest:
        unique.setdefault(each.name, each)
    return tuple(
        sorted(
            unique.values(), key=lambda e: (e.is_single, e.complexity, list(Cause).index(e.cause))
        )
    )


PRESSURE_STAYS = "pressure does not follow the surface (dead load)"
PRESSURE_FOLLOWS = "pressure follows the surface, which linear theory has at rest"
_KINDS = {
    Traction: "traction",
    Pressure: "pressure",
    PointForce: "point forces",
    BodyForce: "body force",
}
UNIT_FACTORS = (1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 10.0, 100.0, 1e3, 1e4, 1e6, 1e9)
# Lengths, as a metre counts in them; an inch is 25.4 mm.
LENGTH_UNITS = {
    1e6: "micrometres",
    1e3: "millimetres",
    100.0: "centimetres",
    10.0: "decimetres",
    1e-3: "kilometres",
    1.0 / 0.0254: "inches",
}
_PLAIN = (0.0, 2.0, 0.5)
# A factor that was found is taken for a known one within this part of it.
_SNAP = 1e-5


def snapped(factor: float) -> float | None:
    """The known factor that this is, of either sign; None where it is none of them."""
    for known in (1.0, *_PLAIN[1:], *UNIT_FACTORS, *LENGTH_UNITS):
        if abs(abs(factor) - known) <= _SNAP * known:
            return known if factor > 0.0 else -known
    return 0.0 if abs(factor) <= _SNAP else None


def load_name(index: int, load: Load) -> str:
    """A load for people: its number in the case, from 1, and its kind."""
    return f"load {index + 1} ({_KINDS[type(load)]})"


def is_unit(factor: float) -> bool:
    """Whether it is one that a mistake of units makes."""
    return abs(factor) in UNIT_FACTORS or abs(factor) in LENGTH_UNITS


def in_words(factor: float) -> str:
    """How many times what was asked."""
    match factor:
        case 0.0:
            return "left out"
        case -1.0:
            return "reversed"
        case 2.0:
            return "counted twice"
        case 0.5:
            return "halved"
    if is_unit(factor):
        times = abs(factor) if abs(factor) > 1.0 else 1.0 / abs(factor)
        turned = " and reversed" if factor < 0.0 else ""
        return f"{times:.4g} times too {'large' if abs(factor) > 1.0 else 'small'}{turned}"
    return f"{factor:.6g} times what was asked"


def displacement_words(factor: float) -> str:
    """A factor of the whole result."""
    if factor == -1.0:
        return "displacement reversed in sign"
    turned = ", reversed" if factor < 0.0 else ""
    unit = LENGTH_UNITS.get(abs(factor))
    if unit is not None:
        return f"displacement in {unit}{turned}"
    return f"displacement {in_words(factor)}"


# A factor is read as one of Poisson's ratio where it is so to four digits: a solver that comes to
# rest to 1e-6 of its forces leaves a tenth of this.
SAME_FACTOR = 1e-4


def factor_formulas(factor: float, nu: float) -> str:
    """Formulas of Poisson's ratio that are this factor, as " = (1 - nu) or ...", or ""."""
    of = {"(1 - nu)": 1.0 - nu, "(1 + nu)": 1.0 + nu, "(1 - 2 nu)": 1.0 - 2.0 * nu}
    of |= {"(1 - nu^2)": 1.0 - nu**2, "(2 (1 + nu))": 2.0 * (1.0 + nu)}
    of |= {f"1 / {formula}": 1.0 / value for formula, value in of.items()}
    found = [f for f, v in of.items() if abs(factor / v - 1.0) <= SAME_FACTOR and v != 1.0]
    return f" = {' or '.join(found)}" if found else ""


def stiffness_words(factor: float, nu: float) -> str:
    """A factor of the stiffness: in statics the same as one over it of every load.

    Where it is one of Poisson's ratio, as of a shear modulus taken for Young's, that is said too.
    """
    over = 1.0 / factor if factor else 0.0
    known = snapped(over)
    loads = f"every load {in_words(over if known is None else known)}" if factor else ""
    if is_unit(factor):
        size = "small" if factor < 1.0 else "large"
        times = factor if factor > 1.0 else 1.0 / factor
        units = {
            1e-3: " (stress in kPa taken for Pa)",
            1e-6: " (stress in MPa taken for Pa)",
            1e3: " (stress in kPa where Pa was asked)",
            1e6: " (lengths in millimetres, forces in newton)",
        }.get(factor, "")
        return f"stiffness {times:.4g} times too {size}{units}, or {loads}"
    formulas = factor_formulas(factor, nu)
    return f"stiffness {factor:.6g} times what was asked{formulas}, or {loads}"
