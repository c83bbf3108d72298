"""Units by their names, turned into SI and back, also in messages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from palpate.meshes.errors import InputError

# Metres in each; the same for the others.
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
STRESS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
DENSITY = {"kg/m3": 1.0, "g/cm3": 1e3}
MASS = {"kg": 1.0, "g": 1e-3}
_NUMBER = r"-?\d+(?:\.\d*)?(?:e[+-]?\d+)?"
# "0.003 m", "(0.1, 0.2, 0.3) m", "[0.1, 0.2, 0.3] m", "10000 Pa"; no speed, area or volume. Words
# that are quoted come first: they stay as they are.
_IN_SI = re.compile(
    rf'"(?:[^"\\]|\\.)*"|(?<![\w.])({_NUMBER}|[(\[]{_NUMBER}(?:, {_NUMBER})*[)\]]) '
    r"(m|Pa)(?![\w/^*])"
)


class Conversions:
    """Between SI and the units that a subclass names."""

    if TYPE_CHECKING:
        length: str
        force: str
        stress: str
        density: str
        mass: str

    def metres(self, value: float) -> float:
        """Turn a length into metres."""
        return value * LENGTH[self.length]

    def lengths(self, values: tuple[float, float, float]) -> tuple[float, float, float]:
        """Turn three lengths into metres."""
        x, y, z = (self.metres(value) for value in values)
        return x, y, z

    def sizes(self, values: Iterable[Any]) -> list[Any]:
        """Turn lengths, or three of them each, into metres."""
        return [self.lengths(v) if isinstance(v, tuple) else self.metres(v) for v in values]

    def in_case_units(self, message: str) -> str:
        """A message from a room that knows SI only, lengths and stresses in the case's units."""

        def own(found: re.Match[str]) -> str:
            size, name = self.of("length" if found[2] == "m" else "stress")
            if found[1] is None or name == found[2]:
                return found[0]
            return f"{re.sub(_NUMBER, lambda n: f'{float(n[0]) / size:.6g}', found[1])} {name}"

        return _IN_SI.sub(own, message)

    @contextmanager
    def in_own_words(self) -> Iterator[None]:
        """Errors raised within name lengths in the case's unit."""
        try:
            yield
        except InputError as error:
            error.args = (self.in_case_units(str(error)),)
            raise

    def newtons(self, value: float) -> float:
        """Turn a force into newtons."""
        return value * FORCE[self.force]

    def newtons_per_metre(self, value: float) -> float:
        """Turn a stiffness, force over length, into N/m."""
        return value * FORCE[self.force] / LENGTH[self.length]

    def pascals(self, value: float) -> float:
        """Turn a stress into pascals."""
        return value * STRESS[self.stress]

    def of(self, dimension: str) -> tuple[float, str]:
        """SI units in one of the case's, and its name, by the dimension of a metric's number."""
        length, force = LENGTH[self.length], FORCE[self.force]
        return {
            "length": (length, self.length),
            "force": (force, self.force),
            "stress": (STRESS[self.stress], self.stress),
            "area": (length**2, f"{self.length}2"),
            "volume": (length**3, f"{self.length}3"),
            "density": (DENSITY[self.density], self.density),
            "mass": (MASS[self.mass], self.mass),
            "energy": (force * length, f"{self.force} {self.length}"),
        }[dimension]

    def kilograms_per_cubic_metre(self, value: float) -> float:
        """Turn a density into kg/m3."""
        return value * DENSITY[self.density]

    def kilograms(self, value: float) -> float:
        """Turn a mass into kg."""
        return value * MASS[self.mass]


@dataclass(frozen=True)
class PlainUnits(Conversions):
    """The unit of a surface or mesh file, beside SI; those of a case are in its schema."""

    length: str = "m"
    force: str = "N"
    stress: str = "Pa"
    density: str = "kg/m3"
    mass: str = "kg"
