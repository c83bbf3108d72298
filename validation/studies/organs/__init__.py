"""Organs as they come: spoiled surfaces repaired and meshed, by a fixed recipe.

Scans, segmentations and CAD leave surfaces that bound no solid. Built-in shapes are spoiled in 25
ways at three severities each, which were written down before any was repaired; each is repaired
and meshed in a process of its own, or refused with the reason.

What comes out is measured without the repair's own code: distances both ways by VTK's locators
from the shape before it was spoiled, volumes cell by cell, faces of cells one by one, and what is
inside by VTK's rays against VTK's search for the cell of a place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import pyplot

from palpate.meshes.errors import InputError
from palpate.meshes.files import SURFACE_SUFFIXES, read_surface
from palpate.meshes.quality import dihedral_angles
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.report.plots import (
    BLUE,
    GREY,
    OCHRE,
    RED,
    Figure,
    figure_svg,
    plot_style,
    tidy,
)
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress
from palpate.validation.studies.organs.measures import Measured, deviation, measure
from palpate.validation.studies.organs.recipe import (
    CPU_LEAST,
    CPU_PER_100K,
    DISTANCE,
    FEWEST,
    FEWEST_MESHED,
    Version,
    versions,
)
from palpate.validation.studies.organs.spoiling import Spoiled, mean_edge
from palpate.validation.studies.organs.trial import Ending, Trial, attempt, try_apart
from palpate.validation.studies.study import Study

# Roundings of volumes, of their own size.
_ROUNDING = 1e-12
_OF_FOLDER = "file"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one surface, and what was measured of its mesh.

    Attributes:
        version: As it was given.
        facets: Given.
        trial: What happened, without the arrays.
        cells: Of the mesh.
        smallest_angle: Of its dihedral angles [degrees].
        allowed: How far it may be from what was meant [m].
        measured: None where there is no mesh.
        edge: Mean edge of what was given [m].
    """

    version: Version
    facets: int
    trial: Trial
    cells: int
    smallest_angle: float
    allowed: float
    measured: Measured | None
    edge: float

    @property
    def cpu(self) -> float:
        """Processor time of repair and mesher [s]."""
        return self.trial.mending_cpu + self.trial.meshing_cpu

    @property
    def is_in_time(self) -> bool:
        """Whether it took no more than its number of triangles allows."""
        allowed = max(CPU_LEAST, CPU_PER_100K * self.facets / 100_000)
        return self.trial.ending is not Ending.OUT_OF_TIME and self.cpu <= allowed

    @property
    def is_near(self) -> bool:
        """Whether both ways the distance is within what is allowed; caps of files are not known."""
        m = self.measured
        if m is None:
            return True
        back = m.to_sound <= self.allowed or self.version.kind == _OF_FOLDER
        return m.from_sound <= self.allowed and back

    @property
    def is_sound(self) -> bool:
        """Whether the mesh is one: cells, faces, volume and inside."""
        m = self.measured
        if m is None:
            return True
        stated = abs(self.trial.mesh_volume - m.volume) <= _ROUNDING * m.volume
        return stated and not (m.wrong_facets or m.flat_cells or m.wrong_places)


def surfaces_in(folder: Path) -> list[Version]:
    """Surfaces of a folder by their names, each read with its own numbers as metres.

    Raises:
        InputError: No such folder, or no surface in it.
    """
    paths = sorted(p for p in folder.glob("*") if p.suffix.lower() in SURFACE_SUFFIXES)
    if not paths:
        raise InputError(f"{folder}: no surface there; use {', '.join(SURFACE_SUFFIXES)}")
    return [Version(p.name, _OF_FOLDER, 0.0, Spoiled(read_surface(p))) for p in paths]


def try_all(
    given: Iterable[Version],
    progress: Progress,
    attempt_one: Callable[..., Trial] = try_apart,
) -> list[Outcome]:
    """Repair, mesh and measure each surface.

    Args:
        given: Surfaces.
        progress: Told what is tried.
        attempt_one: In a process of its own, or in this one.
    """
    outcomes = []
    for version in given:
        progress(f"{version.name}: {version.spoiled.surface.num_facets} facets")
        outcomes.append(_outcome(version, attempt_one))
    return outcomes


def _outcome(version: Version, attempt_one: Callable[..., Trial]) -> Outcome:
    spoiled = version.spoiled
    edge = mean_edge(spoiled.sound or spoiled.surface)
    distance = DISTANCE * edge
    allowed = spoiled.size + distance
    trial = attempt_one(spoiled.surface, distance=distance, smallest_shell=spoiled.smallest_shell)
    found, cells, angle = None, 0, float("nan")
    if trial.ending is Ending.MESHED:
        arrays = trial.arrays
        mended = TriSurface(arrays["points"], arrays["facets"])
        points, rows = arrays["mesh_points"], arrays["mesh_cells"]
        cells = len(rows)
        angle = float(np.degrees(dihedral_angles(points, rows)).min())
        sound = spoiled.sound or spoiled.surface
        # What a file means where it is open is not known: the mended surface stands for it.
        if version.kind == _OF_FOLDER:
            found = measure(mended, points, rows, mended, allowed=0.01 * edge)
            found = found._replace(
                to_sound=deviation(mended, sound), from_sound=deviation(sound, mended)
            )
        else:
            found = measure(mended, points, rows, sound, allowed=allowed)
    bare = Trial(trial.ending, trial.said, trial.mending_cpu, trial.meshing_cpu, trial.mesh_volume)
    facets = spoiled.surface.num_facets
    return Outcome(version, facets, bare, cells, angle, allowed, found, edge)


def judge(outcomes: list[Outcome]) -> list[Finding]:
    """What a person with a scan asks."""
    made = [o for o in outcomes if o.version.kind != _OF_FOLDER]
    meshed = [o for o in made if o.trial.ending is Ending.MESHED]
    ended = [o for o in outcomes if o.trial.ending in (Ending.MESHED, Ending.REFUSED)]
    far = [o for o in outcomes if not o.is_near]
    unsound = [o for o in outcomes if not o.is_sound]
    slow = [o for o in outcomes if not o.is_in_time]
    worst = max(outcomes, key=lambda o: o.cpu / o.facets)
    furthest = max(
        (o for o in outcomes if o.measured and o.version.kind != _OF_FOLDER),
        key=lambda o: max(o.measured[:2]) / o.allowed,  # type: ignore[index]
        default=None,
    )
    ratio = max(furthest.measured[:2]) / furthest.allowed if furthest else 0.0  # type: ignore[index]
    return [
        judged(
            f"of at least {FEWEST} spoiled versions at least {FEWEST_MESHED} are repaired in place "
            "and meshed",
            f"{len(meshed)} of {len(made)}",
            len(made) >= FEWEST and len(meshed) >= FEWEST_MESHED,
        ),
        judged(
            "each is meshed or refused for a stated reason: none crashes, none has to be ended",
            _names([o for o in outcomes if o not in ended]) or f"all {len(ended)} as they should",
            len(ended) == len(outcomes) and all(o.trial.said for o in ended),
        ),
        judged(
            f"both ways no surface is further from what was meant than the defect and {DISTANCE:g} "
            "mean edges, by VTK",
            _names(far) or f"the furthest has {100.0 * ratio:.0f} % of that ({_names([furthest])})"
            if furthest
            else "nothing was meshed",
            not far,
        ),
        judged(
            "every mesh is one: cells of positive volume, faces shared by two or on the surface, "
            "the stated volume, and the inside where VTK's rays find it",
            _names(unsound) or "all are",
            not unsound,
        ),
        judged(
            f"none takes more than {CPU_PER_100K:g} s of the processor per 100 000 triangles "
            f"(small ones {CPU_LEAST:g} s)",
            _names(slow) or f"at most {worst.cpu:.2g} s on {worst.facets} ({worst.version.name})",
            not slow,
        ),
    ]


def _names(outcomes: Sequence[Outcome | None]) -> str:
    return ", ".join(o.version.name for o in outcomes if o)


def present(outcomes: list[Outcome]) -> Page:
    """How far each mended surface is from what was meant, and all that was measured."""
    columns = {
        "surface": "", "facets": "d", "ending": "", "cells": "d", "smallest dihedral [deg]": ".3g",
        "to the sound one [edges]": ".3f", "from it [edges]": ".3f", "allowed [edges]": ".3g",
        "volume [m3]": ".6g", "volume change [%]": "+.3f", "wrong faces": "d", "wrong places": "d",
        "repair [s]": ".2f", "mesher [s]": ".2f", "what was said": "",
    }  # fmt: skip
    figure = Figure(
        _draw(outcomes),
        "Distance of the mended surface from the one before it was spoiled (circles) and back "
        "(crosses), over the mean edge, by VTK; grey: what is allowed. Red names were refused.",
    )
    table = Table("Spoiled surfaces", columns, [_row(o) for o in outcomes])
    remarks = [f"{o.version.name}: {o.trial.said}" for o in outcomes if o.measured is None]
    return Page(figures={"deviations": figure}, tables={"surfaces": table}, remarks=remarks)


def _row(o: Outcome) -> tuple[object, ...]:
    m, t = o.measured, o.trial
    found: tuple[object, ...] = (None,) * 9
    if m is not None:
        found = (
            o.cells, o.smallest_angle, m.to_sound / o.edge, m.from_sound / o.edge,
            o.allowed / o.edge, m.volume, 100.0 * m.volume_change, m.wrong_facets, m.wrong_places,
        )  # fmt: skip
    return (o.version.name, o.facets, str(t.ending), *found, t.mending_cpu, t.meshing_cpu, t.said)


def _draw(outcomes: Sequence[Outcome]) -> str:
    smallest = 1e-6
    with plot_style():
        figure, axes = pyplot.subplots(figsize=(9.0, 1.2 + 0.16 * len(outcomes)))
        for place, o in enumerate(reversed(outcomes)):
            m = o.measured
            if m is None:
                continue
            axes.plot([smallest, o.allowed / o.edge], [place, place], color=GREY, lw=0.8, alpha=0.4)
            axes.plot(max(m.to_sound / o.edge, smallest), place, "o", color=BLUE, ms=4, mfc="none")
            axes.plot(max(m.from_sound / o.edge, smallest), place, "x", color=OCHRE, ms=4)
        axes.set_xscale("log")
        axes.set_xlabel("distance over the mean edge")
        names = [o.version.name for o in reversed(outcomes)]
        axes.set_yticks(range(len(names)), names, fontsize=7)
        for tick, o in zip(axes.get_yticklabels(), reversed(outcomes), strict=True):
            tick.set_color("black" if o.measured else RED)
        axes.set_ylim(-1, len(outcomes))
        tidy(axes)
        figure.tight_layout()
        return figure_svg(figure)


def study_of(folder: Path | None = None) -> Study[list[Outcome]]:
    """The study, with the surfaces of a folder beside the recipe's."""

    def compute(progress: Progress) -> list[Outcome]:
        more = [] if folder is None else surfaces_in(folder)
        return try_all([*versions(), *more], progress)

    return Study(TITLE, __doc__, compute, judge, present)


TITLE = "Organs as they come: spoiled surfaces repaired and meshed"
STUDY = study_of()
__all__ = ["STUDY", "Outcome", "attempt", "judge", "present", "study_of", "surfaces_in", "try_all"]
