"""What an error bar is made of, by name, and the one rule by which the parts make the whole.

Each part bounds one cause, and bounds add whatever their signs are: the whole is the sum of
discretisation (mesh and degree), algebra (what the equations are solved to), time (its step), and
of what one check adds by itself: reading (between the states or points that were sent) and stated
(the uncertainty of the number expected).

Geometry stands beside the whole. A case's truth solves the body that the case gives, which for a
curved shape is a polyhedron, and a candidate is given the same polyhedron: what the true surface
would change is no doubt in their comparison, and in the bar it would turn every verdict on a
curved body into "inconclusive" for what no candidate can help. It is told beside the verdict, and
it counts where the truth is held against a number of the true body: one that is published,
measured or in closed form.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate.meshes.problem import Strain
from palpate.validation.references.sequences import NOISE

# Where a file's provenance keeps them.
PARTS = "bar_parts"
# And what the case's mesh is a polyhedron of.
GEOMETRY = "geometry"
_WORDS = {"discretisation": "mesh"}
# Of the whole: a smaller part is not told in a verdict.
_WORTH_TELLING = 0.01


@dataclass(frozen=True)
class BarParts:
    """Parts of one error bar, each >= 0, in one unit; infinite where a cause cannot be bounded.

    Attributes:
        discretisation: Of the mesh and the degree of its elements.
        algebra: Of equations solved to a tolerance.
        time: Of the time step.
        geometry: Of the case's polyhedron from the true surface: beside the whole.
        reading: Of one comparison: between the points and times that were sent.
        stated: Of one comparison: of the number expected, as the case states it.

    >>> BarParts(discretisation=0.003, time=0.001, geometry=0.2).whole
    0.004
    """

    discretisation: float = 0.0
    algebra: float = 0.0
    time: float = 0.0
    geometry: float = 0.0
    reading: float = 0.0
    stated: float = 0.0

    @property
    def whole(self) -> float:
        """The sum of all but geometry."""
        return float(sum(value for name, value in vars(self).items() if name != "geometry"))

    def times(self, factor: float) -> BarParts:
        """The same in another unit; what is not there at all stays 0 in every one."""
        return BarParts(**{n: v * factor if v else 0.0 for n, v in vars(self).items()})

    def told(self, *, with_geometry: bool = False) -> dict[str, float]:
        """The parts that are there, by name, the largest first."""
        kept = {n: v for n, v in vars(self).items() if v and (with_geometry or n != "geometry")}
        return dict(sorted(kept.items(), key=lambda item: -item[1]))

    def says(self, *, with_geometry: bool = False) -> str:
        """The parts that matter, in words; empty where there is one only."""
        told = self.told(with_geometry=with_geometry)
        least = _WORTH_TELLING * self.whole
        kept = [
            f"{_WORDS.get(n, n)} {v:.2g}" for n, v in told.items() if v >= least or math.isinf(v)
        ]
        return ", ".join(kept) if len(kept) > 1 else ""


def of_statics(bar: float, *, noise: float = NOISE) -> BarParts:
    """A bar from meshes, which has what solving leaves in a number in it."""
    algebra = min(bar, noise)
    return BarParts(discretisation=math.inf if math.isinf(bar) else bar - algebra, algebra=algebra)


def with_bar(parts: BarParts, bar: float) -> BarParts:
    """Parts whose whole is a bar that was made infinite after them."""
    lost = math.isinf(bar) and math.isfinite(parts.whole)
    return dataclasses.replace(parts, discretisation=math.inf) if lost else parts


def as_record(parts: Mapping[tuple[str, Strain], BarParts]) -> dict[str, dict[str, float | None]]:
    """For a file's provenance; JSON knows no infinity: None."""
    return {
        f"{metric}|{strain}": {
            name: value if math.isfinite(value) else None
            for name, value in vars(one).items()
            if value
        }
        for (metric, strain), one in parts.items()
    }


def recorded(provenance: Mapping[str, Any], metric: str, strain: Strain, bar: float) -> BarParts:
    """The parts that a file keeps of a bar; of one without them all is discretisation."""
    table = provenance.get(PARTS)
    row = table.get(f"{metric}|{strain}") if isinstance(table, Mapping) else None
    return read_row(row) or BarParts(discretisation=bar)


def read_row(row: Any) -> BarParts | None:
    """The parts in one row of a record that anybody may have written; None where it is none."""
    if not isinstance(row, Mapping):
        return None
    values = {name: math.inf if value is None else value for name, value in row.items()}
    names = {field.name for field in dataclasses.fields(BarParts)}
    numbers = all(
        isinstance(v, int | float) and not isinstance(v, bool) and v >= 0.0 for v in values.values()
    )
    return BarParts(**values) if numbers and values.keys() <= names else None


def wrong_record(
    provenance: Mapping[str, Any], bars: Mapping[tuple[str, Strain], float], rounding: float
) -> list[str]:
    """What cannot be in a record of parts: rows without a bar, no numbers, other sums."""
    table = provenance.get(PARTS, {})
    if not isinstance(table, Mapping):
        return [f"{PARTS}: not a table"]
    known = {f"{metric}|{strain}": bar for (metric, strain), bar in bars.items()}
    found = []
    for name, row in table.items():
        parts = read_row(row)
        if parts is None or name not in known:
            found.append(f"{PARTS} of {name}: not the parts of an error bar of this file")
            continue
        bar, whole = known[name], parts.whole
        if whole != bar and not abs(whole - bar) <= rounding * bar:
            found.append(f"{PARTS} of {name} add up to {whole:.4g}, but the bar is {bar:.4g}")
    return found
