"""A bar whose markers were measured, as a case with files: synthetic, from a solution and noise."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.statics import solve_static
from palpate.meshes.problem import Element
from palpate.validation.case import Case, load_case
from palpate.validation.case.measurements import pins_of
from palpate.validation.case.variants import with_values

MARKERS = {
    "above": (100.0, 10.0, 26.0),
    "left": (100.0, -6.0, 15.0),
    "middle": (50.0, 10.0, 26.0),
}
CASE = """
schema = 1
title = "A bar that bends by its weight and by what hangs on it"
[units]
length = "mm"
mass = "g"
[material]
law = "neo-hookean-stable"
youngs_modulus = 100e3
poissons_ratio = 0.4
density = 1e3
[geometry]
shape = "box"
size = [100.0, 20.0, 20.0]
edge_length = 10.0
[[support]]
region = { half_space = { point = [0.1, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]
[[mass]]
mass = 10.0
region = { box = { min = [90.0, -1.0, 19.9], max = [101.0, 21.0, 21.0] } }
[[check]]
metric = "displacement_l2"
limit = 1e-6
reason = "the same equations"
"""
MEASUREMENT = """
[[measurement]]
name = "NAME"
kind = "rest"
files = ["NAME_1.csv", "NAME_2.csv"]
set = SET
markers = ["above", "left", "middle"]
frame = ["above", "left", "middle"]
frame_limit = 1.0
start = 1.0
rest_limit = 0.5
limit = 2.0
reason = "a tenth of what it moves"
"""
FORCE_CURVE = """
[[measurement]]
name = "press"
kind = "tool_force"
files = ["press.csv"]
tool = 1
component = "z"
uncertainty = 0.002
"""
TRUE = {"material.youngs_modulus": 130e3, "material.poissons_ratio": 0.4}
EXPERIMENTS: dict[str, dict[str, float]] = {"hung": {}, "bare": {"mass[0].mass": 0.0}}


def case_text(more: str = "") -> str:
    """The case with its markers and both measurements; `more` stands at its end."""
    markers = "".join(
        f'[[marker]]\nname = "{name}"\nposition = {list(at)}\nradius = 6.0\n'
        for name, at in MARKERS.items()
    )
    measured = ""
    for name, numbers in EXPERIMENTS.items():
        inline = ", ".join(f'"{key}" = {value}' for key, value in numbers.items())
        measured += MEASUREMENT.replace("NAME", name).replace("SET", "{ " + inline + " }")
    return CASE + markers + measured + more


def write_tracks(
    path: Path, motions: Mapping[str, NDArray[np.float64]], *, still: bool = True
) -> None:
    """A file in which each marker [mm] is at its position, then rests moved by so much [mm]."""
    names = [f"{name}_{axis}_mm" for name in motions for axis in "xyz"]
    with path.open("w", encoding="utf-8", newline="") as text:
        rows = csv.writer(text)
        rows.writerow(["time_s", *names])
        for step in range(41):
            part = min(step / 10.0, 1.0) if still else step / 40.0
            places = [np.array(MARKERS[name]) + part * moved for name, moved in motions.items()]
            rows.writerow([f"{0.05 * step:.2f}", *(f"{x:.9f}" for x in np.concatenate(places))])


def exact_motions(
    case: Case, *, element: Element = Element.SMOOTHED, true: Mapping[str, float] = TRUE
) -> dict[str, NDArray[np.float64]]:
    """Motion of the markers [mm] in each experiment of the body that was "measured", (3, 3)."""
    found = {}
    for name, numbers in EXPERIMENTS.items():
        problem = with_values(case, {**true, **numbers}).problem
        u = solve_static(problem, strain=case.strain, element=element).displacement
        pins = pins_of(case, tuple(MARKERS))
        found[name] = 1e3 * np.array([p.moved(problem.mesh.points, u) for p in pins.values()])
    return found


def measured_bar(
    folder: Path, *, noise: float = 0.1, seed: int = 36, element: Element = Element.SMOOTHED,
    more: str = "",
) -> Case:  # fmt: skip
    """The case with files of two runs of each experiment, with noise [mm] of each component."""
    path = folder / "bar.toml"
    path.write_text(case_text(more), "utf-8")
    case, rng = load_case(path), np.random.default_rng(seed)
    for name, motions in exact_motions(case, element=element).items():
        for run in (1, 2):
            noisy = motions + noise * rng.standard_normal(motions.shape)
            write_tracks(folder / f"{name}_{run}.csv", dict(zip(MARKERS, noisy, strict=True)))
    return case
