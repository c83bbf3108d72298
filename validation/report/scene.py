"""What a picture shows, as plain data, and its drawing in a process of its own.

VTK ends the process where graphics libraries are missing, so the parent only looks at what
files are there afterwards, and lets matplotlib draw instead when there are none.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.exchange.nodal_arrays import are_among

GREEN, BLUE, RED, GREY, TAN, OCHRE = (
    "#2f8f4e", "#30558f", "#b5332e", "#d9d9d9", "#e3d9d0", "#c98a12",
)  # fmt: skip
DRAWN_BY = ("pyvista", "matplotlib")
# What a picture can be: .png by either, the others by matplotlib, as lines and text.
FORMS = ("png", "pdf", "svg")
# A tool may reach beyond the bodies by this part of their size before the frame cuts it.
BEYOND = 0.3


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in one colour, or in those of a number at each point.

    Attributes:
        points: (num_points, 3).
        facets: (num_facets, 3).
        colour: Where there are no values.
        values: By point, shown with a bar of colours; None for one colour.
        values_name: What they are.
        largest: Where the bar ends.
        colours: Name of matplotlib's map.
        opacity: 0..1.
        is_wireframe: Edges only, in the colour.
        is_beside: A tool, which may reach beyond the frame: it widens that by `BEYOND` at most.
    """

    points: Points
    facets: Indices
    colour: str = GREY
    values: Points | None = None
    values_name: str = ""
    largest: float = 1.0
    colours: str = "viridis"
    opacity: float = 1.0
    is_wireframe: bool = False
    is_beside: bool = False


@dataclass(frozen=True, eq=False)
class Marks:
    """Arrows (starts and vectors), a path, or single points, in one colour."""

    points: Points
    colour: str
    vectors: Points | None = None
    is_path: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """One look at a body.

    Attributes:
        title: Above it.
        surfaces: What is seen.
        marks: In front of that.
        side: From where one looks.
        unit: Of the extents that are written beside the body; "" for none.
        legend: Words and their colours.
    """

    title: str
    surfaces: Sequence[Surface]
    side: tuple[float, float, float]
    marks: Sequence[Marks] = ()
    unit: str = ""
    legend: Sequence[tuple[str, str]] = ()

    @property
    def reached(self) -> Points:
        """Every place that is drawn, but what stands beside, (n, 3)."""
        heads = [m.points + m.vectors for m in self.marks if m.vectors is not None]
        places = [m.points for m in self.marks]
        return np.vstack([*(s.points for s in self.surfaces if not s.is_beside), *places, *heads])


def extent(panels: Sequence[Panel]) -> tuple[Points, Points]:
    """Lowest and highest corner of all that is drawn, of tools as far as the frame follows them."""
    reached = np.vstack([panel.reached for panel in panels])
    low, high = reached.min(axis=0), reached.max(axis=0)
    beyond = BEYOND * float((high - low).max())
    beside = [s.points for panel in panels for s in panel.surfaces if s.is_beside]
    for points in beside:
        low = np.minimum(low, np.maximum(points.min(axis=0), reached.min(axis=0) - beyond))
        high = np.maximum(high, np.minimum(points.max(axis=0), reached.max(axis=0) + beyond))
    return low, high


def draw(
    pictures: Mapping[str, Sequence[Panel]],
    *,
    by: Sequence[str] = DRAWN_BY,
    form: str = "png",
    time_limit: float = 180.0,
) -> dict[str, bytes]:
    """Draw each picture, its panels side by side.

    Args:
        pictures: By name.
        by: Who may draw, in the order in which they are tried.
        form: One of `FORMS`; of a paper's two columns in width where it is not "png".
        time_limit: Of each [s].

    Returns:
        The bytes of every picture that came about; none where nobody managed.
    """
    with scratch_folder("pictures") as scratch:
        source = scratch / "panels.pickle"
        source.write_bytes(pickle.dumps(dict(pictures)))
        for name in by if form == "png" else ("matplotlib",):
            module = f"palpate.validation.report.by_{name}"
            try:
                done = run_supervised(
                    [sys.executable, "-m", module, source, scratch, form],
                    time_limit=time_limit,
                    env={**os.environ, "PYVISTA_OFF_SCREEN": "true"},
                )
            except (subprocess.SubprocessError, OSError):
                continue
            made = {path.stem: path.read_bytes() for path in sorted(scratch.glob(f"*.{form}"))}
            if done.returncode == 0 and made:
                return made
    return {}


def joined(parts: Iterable[Indices | None]) -> Indices:
    """Facets of several parts, (num_facets, 3); None has none."""
    known = [part for part in parts if part is not None]
    return np.vstack([np.zeros((0, 3), dtype=np.int32), *known])


def boundary(points: Points, facets: Indices, held: Indices, pushed: Indices) -> list[Surface]:
    """A body's boundary: what is held blue, what is pushed red, the rest in the colour of skin."""
    is_held, is_pushed = (are_among(facets, part) for part in (held, pushed))
    kinds = ((~is_held & ~is_pushed, TAN), (is_pushed & ~is_held, RED), (is_held, BLUE))
    return [Surface(points, facets[rows], colour) for rows, colour in kinds if rows.any()]
