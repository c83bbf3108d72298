"""Do the truth's error bars hold the true error?

Each problem has a solution that is known ten times better than the bar: a closed form, a series,
one or two dimensions solved far better, a manufactured field, or, of slender bars alone, cubic
tetrahedra on meshes graded much further. Of round bodies the solution is that of the round one, and
the bar has its geometry part, as where a case is compared with a published number. The truth is
found as for a case, stored (adaptive meshes; of motions three time steps and three meshes) and live
(on the spot), and each of its numbers is compared with it. A bar covers where it is at least the
error. Infinite bars cover nothing and count as the widest.

Factors and estimators may be chosen by half of the problems. The other half was set apart by the
hash of their names before any factor was chosen; the claims here are of that half alone, and each
run on it is written down in calibration_runs.toml.

Problems and solutions are stored in calibration.tar.xz with a hash of them, which is checked; how
they were drawn and found is in tests/bank/calibration_recipe, with which a test compares one of
each family, and every night all of them.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import tarfile
import tempfile
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.fingerprint import file_hash
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import load_problem
from palpate.meshes.true_surfaces import CurvedPart, spherical_parts, upright_parts
from palpate.meshes.untrusted import read_npz
from palpate.reference.errors import ReferenceFailedError
from palpate.validation.metrics import CATALOGUE, WHOLE_BODY_METRICS, Part, measure
from palpate.validation.metrics.difference import make_state
from palpate.validation.references.adaptive_truth import TruthRequest, solve_truth
from palpate.validation.references.bars import name_of_part
from palpate.validation.references.geometry import geometry_part
from palpate.validation.references.motions import solve_motion_set, truth_metrics
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.statics import solve_live
from palpate.validation.report.plots import Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged
from palpate.validation.states import Progress, State, StressIntegrals, Trajectory

TITLE = "Error bars against known solutions"

LEAST_COVERED, LARGEST_MISS, LARGEST_WIDTH = 0.95, 1.5, 5.0
STORE = Path(__file__).with_name("calibration.tar.xz")
LOG = Path(__file__).with_name("calibration_runs.toml")
HASH = "sha256"  # the file of the store that holds `store_hash`
STRESS = "stress_l2"
STORED, LIVE = "stored", "live"
WAYS = (STORED, LIVE)
# Solved as for storing alone: on the spot nearly all their numbers are the same.
STORED_ALONE = ("inflated", "twisted", "stress", "ring", "impact", "pressed")
# What is asked of every truth: bars this small, or the budget spent, which is the same on every
# machine.
_BAR, _SECONDS, _UNKNOWNS = 0.02, 1800.0, 50_000.0
# A solution is known where its own doubt is at most this part of the bar.
KNOWN = 0.1
# Both below this are equal: what solvers leave.
_ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class Known:
    """A problem whose solution is known, called FAMILY-NUMBER, and its generation from the second.

    `is_apart`: no factor is chosen by it. `given` is what it was made with; `solution` is None
    where the body bears no such load; `doubts` say how well each metric of it is known, relative;
    those not named as "" is. Where the sides lie on a `surface`, "spheres" or "cylinders", of some
    `radii` [m], the solution is that of the round body, and its sizes are the mesh's, changed as
    the round body's are.
    """

    name: str
    family: str
    is_apart: bool
    given: Mapping[str, Any]
    problem: Problem
    strain: Strain
    solution: State | None
    doubts: Mapping[str, float]
    surface: str = ""
    radii: Sequence[float] = ()

    @property
    def curved_parts(self) -> list[CurvedPart]:
        """The sides that lie on its surfaces, none of a polyhedron."""
        if not self.surface:
            return []
        mesh, is_upright = self.problem.mesh, self.surface == "cylinders"
        found = (upright_parts if is_upright else spherical_parts)(mesh, self.radii)
        return [
            # Flat sides through the middle have corners at more than one radius.
            replace(part, facets=part.facets[(abs(lengths - radius) < 1e-9 * radius).all(axis=1)])
            for part, radius in zip(found, self.radii, strict=True)
            for lengths in (
                np.linalg.norm(mesh.points[part.facets][:, :, : 2 if is_upright else 3], axis=2),
            )
        ]


def store_hash(folder: Path) -> str:
    """SHA-256 over the names and contents of an unpacked store's files, but its own."""
    digest = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        if file.name != HASH:
            digest.update(f"|{file.name}|{file_hash(file)}".encode())
    return digest.hexdigest()


def known_problems(store: Path = STORE) -> list[Known]:
    """All problems, family by family.

    Raises:
        FileFormatError: The store has not the hash that it was written with.
    """
    with tempfile.TemporaryDirectory() as name, tarfile.open(store) as tar:
        folder = Path(name)
        for member in tar:
            file = tar.extractfile(member)
            if file is not None:
                (folder / Path(member.name).name).write_bytes(file.read())
        stated = folder / HASH
        if not stated.is_file() or stated.read_text("utf-8") != store_hash(folder):
            raise FileFormatError(store, "has changed since it was written: it has not its hash")
        index = json.loads((folder / "index.json").read_text("utf-8"))
        return [_read(folder, entry) for entry in index]


def _read(folder: Path, entry: Mapping[str, Any]) -> Known:
    problem = load_problem(folder / f"{entry['name']}.npz")
    strain, doubts, solution = Strain(entry["strain"]), entry["doubts"], None
    if doubts is not None:
        arrays = read_npz(folder / f"{entry['name']}.answer.npz")
        motion = None
        if problem.time is not None:
            motion = Trajectory(arrays["times"], arrays["displacements"])
        u = arrays["displacement"] if motion is None else motion.displacements[-1]
        state = make_state(
            problem.mesh, u, label="known", simulator="known", strain=strain, trajectory=motion
        )
        volume, area = arrays["sizes"].tolist()
        integrals = None
        if "cauchy" in arrays:
            integrals = StressIntegrals(arrays["cauchy"], np.zeros_like(problem.mesh.points))
        solution = replace(state, volume=volume, surface_area=area, integrals=integrals)
    name, family, is_apart = entry["name"], entry["family"], entry["is_apart"]
    given, doubts = entry["given"], doubts or {}
    on = entry["surface"], entry["radii"]
    return Known(name, family, is_apart, given, problem, strain, solution, doubts, *on)


class Number(NamedTuple):
    """One number of one truth; bar, error and the solution's doubt are relative."""

    problem: str
    family: str
    is_apart: bool
    way: str
    metric: str
    bar: float
    error: float
    doubt: float

    @property
    def is_known(self) -> bool:
        """Whether the solution is known ten times better than the bar, or clearly outside it."""
        return self.doubt <= max(KNOWN * self.bar, _ROUNDING) or self.miss > 1.0 + KNOWN

    @property
    def miss(self) -> float:
        """Error over bar, the solution's doubt in the error's favour."""
        error = max(self.error - self.doubt, 0.0)
        return 0.0 if error <= _ROUNDING else error / self.bar

    @property
    def width(self) -> float:
        """Bar over error, neither of which is below rounding."""
        return max(self.bar, _ROUNDING) / max(self.error, self.doubt, _ROUNDING)


class Summary(NamedTuple):
    """What the numbers of one way say together; parts are of finite bars with a known solution.

    `infinite` bars say that nothing is known: they cover nothing, and are the widest of all in the
    median. `unknown` are left out: their solutions are not known well enough.
    """

    numbers: int
    covered: float
    worst: float
    width: float
    infinite: int
    unknown: int


def summarise(numbers: Sequence[Number]) -> Summary:
    """Coverage and sharpness."""
    known = [n for n in numbers if n.is_known]
    finite = [n for n in known if math.isfinite(n.bar)]
    misses = [n.miss for n in finite]
    return Summary(
        len(finite),
        float(np.mean([m <= 1.0 for m in misses])) if misses else math.nan,
        max(misses, default=math.nan),
        float(np.median([n.width for n in known])) if known else math.nan,
        len(known) - len(finite),
        len(numbers) - len(known),
    )


def compare(known: Known, way: str, progress: Progress) -> list[Number]:
    """The numbers of one problem, STORED or LIVE; none where there is no truth at all."""
    problem, solution = known.problem, known.solution
    if solution is None:
        progress("it has no known solution")
        return []
    try:
        truth, bars = (_stored if way == STORED else _live)(known, progress)
        if known.surface:
            of_sides = geometry_part(problem, known.curved_parts, truth, progress)
            bars = {metric: bar + of_sides[metric] for metric, bar in bars.items()}
    except ReferenceFailedError as failure:
        progress(f"no truth: {failure}")
        return []
    found = []
    for metric, bar in bars.items():
        try:
            # As a candidate that is right would be judged: in units of the truth's own scale.
            error = measure(metric, problem, solution, truth, _everywhere(problem)).value
        except InputError:  # nothing swings
            continue
        doubt = known.doubts.get(metric, known.doubts.get("", 0.0))
        head = known.name, known.family, known.is_apart
        found.append(Number(*head, way, metric, bar, error, doubt))
    return found


def compare_all(
    problems: Iterable[Known],
    progress: Progress,
    *,
    ways: Sequence[str] = WAYS,
    jobs: int = 1,
) -> list[Number]:
    """The numbers of problems, in the given ways; so many at once, each in a process of its own."""

    def one(known: Known, way: str) -> list[Number]:
        return compare(known, way, lambda line: progress(f"{known.name}, {way}: {line}"))

    with ThreadPoolExecutor(jobs) as pool:  # truths are solved in child processes
        lists = [
            pool.submit(one, known, way)
            for known in problems
            for way in ways
            if way == STORED or known.family not in STORED_ALONE
        ]
        try:
            return [number for each in lists for number in each.result()]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _everywhere(problem: Problem) -> Part:
    """The whole body, as the part in which stress is asked."""
    cells = np.arange(problem.mesh.num_cells, dtype=np.int32)
    return Part(cells, np.zeros_like(problem.mesh.points))


def _stored(known: Known, progress: Progress) -> tuple[State, dict[str, float]]:
    problem, strain = known.problem, known.strain
    if problem.time is None:
        assert known.solution is not None
        names = dict(zip(WHOLE_BODY_METRICS, WHOLE_BODY_METRICS, strict=True))
        request = _request(strain)
        if known.solution.integrals is not None:
            part = _everywhere(problem)
            names[STRESS] = name_of_part(STRESS, part)
            request = replace(request, parts={strain: [(STRESS, part)]})
        state, bars, _ = solve_truth(problem, strain, request, progress)
        return state, {metric: bars[name] for metric, name in names.items()}
    found = solve_motion_set(
        problem, progress, wanted=("truth",), is_for_storing=True, truth_strains=(strain,)
    )
    return _of(found, problem, strain)


def _live(known: Known, progress: Progress) -> tuple[State, dict[str, float]]:
    problem, strain = known.problem, known.strain
    found = solve_live(
        problem,
        progress,
        wanted=("truth",),
        request=_request(strain),
        has_stress=False,
        strains=(strain,),
    )
    return _of(found, problem, strain)


def _request(strain: Strain) -> TruthRequest:
    metrics = {strain: tuple(WHOLE_BODY_METRICS)}
    return TruthRequest(_BAR, _SECONDS, metrics=metrics, unknowns=_UNKNOWNS)


def _of(found: ReferenceSet, problem: Problem, strain: Strain) -> tuple[State, dict[str, float]]:
    truth = found.truth(strain)
    if truth is None:
        raise ReferenceFailedError(found.failure("truth", strain) or "no truth")
    names = tuple(WHOLE_BODY_METRICS)
    if problem.time is not None:
        names = tuple(m for m in truth_metrics(problem) if not CATALOGUE[m].needs_tools)
    return truth, {name: found.bars.get((name, strain), math.inf) for name in names}


class Found(NamedTuple):
    """Every number, the problems that were run, and the processor time it took [s]."""

    numbers: tuple[Number, ...]
    problems: tuple[Known, ...]
    processor_time: float = 0.0


def compute(progress: Progress) -> Found:
    """All problems, stored and live, two at once."""
    problems, begun = known_problems(), _processor_time()
    jobs = min(2, os.cpu_count() or 1)
    numbers = compare_all(problems, progress, jobs=jobs)
    return Found(tuple(numbers), tuple(problems), _processor_time() - begun)


def _processor_time() -> float:
    """Of this process and of its children that have ended [s]."""
    return sum(os.times()[:4])


def judge(found: Found) -> list[Finding]:
    """The three numbers, stored and live, of the half that was set apart."""
    findings = []
    for way in WAYS:
        of = [n for n in found.numbers if n.way == way and n.is_apart]
        s = summarise(of)
        said = f"{s.numbers} numbers, {s.infinite} without a bar, {s.unknown} left out"
        findings += [
            judged(
                f"{way}: bars cover at least {100 * LEAST_COVERED:.0f} % of the numbers",
                f"{100 * s.covered:.1f} % ({said})",
                s.covered >= LEAST_COVERED,
            ),
            judged(
                f"{way}: no error above {LARGEST_MISS:g} times its bar",
                f"at most {s.worst:.2f} times",
                s.worst <= LARGEST_MISS,
            ),
            judged(
                f"{way}: half of the bars are at most {LARGEST_WIDTH:g} times the error",
                f"median {s.width:.1f}",
                s.width <= LARGEST_WIDTH,
            ),
        ]
    return findings


def present(found: Found) -> Page:
    """Bar against error, coverage and sharpness by family, every number, and the log."""
    rows = [
        (family, way, half, *summarise(of))
        for way in WAYS
        for half, is_apart in (("set apart", True), ("open", False))
        for family in (*dict.fromkeys(n.family for n in found.numbers), "all")
        if (
            of := [
                n
                for n in found.numbers
                if n.way == way and n.is_apart == is_apart and family in (n.family, "all")
            ]
        )
    ]
    columns = {"family": "", "truth": "", "half": "", "numbers": "d", "covered": ".3f"}
    columns |= {"worst error / bar": ".2f", "median bar / error": ".1f"}
    columns |= {"without a bar": "d", "left out": "d"}
    every = {"problem": "", "family": "", "set apart": "", "truth": "", "metric": ""}
    every |= {"bar": ".2g", "error": ".2g", "solution known to": ".1g"}
    runs = tomllib.loads(LOG.read_text("utf-8")).get("run", [])
    return Page(
        figures={"calibration": draw(found.numbers)},
        tables={
            "families": Table("By family", columns, rows),
            "runs": Table(
                "Runs on the half that is set apart",
                {"date": "", "version": "", "generation": "d", "truth": "", "families": ""}
                | {"numbers": "d", "covered": ".3f", "worst": ".2f", "width": ".1f"},
                [_of_run(run) for run in runs],
            ),
            "numbers": Table(
                "Every number",
                every,
                [(n[0], n[1], "yes" if n.is_apart else "no", *n[3:]) for n in found.numbers],
                is_shown=False,
            ),
        },
        remarks=[
            "A run on the half that is set apart belongs in calibration_runs.toml.",
            f"Processor time: {found.processor_time / 60.0:.0f} minutes.",
        ],
        numbers={
            "problems": [problem.name for problem in found.problems],
            "processor_time": found.processor_time,
        },
    )


def _of_run(run: dict[str, Any]) -> tuple[Any, ...]:
    keys = ("version", "generation", "truth", "families", "numbers", "covered", "worst", "width")
    return (str(run["date"]), *(run[key] for key in keys))


def draw(numbers: Sequence[Number]) -> Figure:
    """Error over bar, a panel for each way: what lies above the line is not covered."""
    panels = []
    for way in WAYS:
        of = [n for n in numbers if n.way == way and n.is_known and np.isfinite(n.bar)]
        ends = [1e-6, 1.0]
        lines = [Line(ends, ends, style="-", colour="black", width=0.8)]
        for family in dict.fromkeys(n.family for n in of):
            points = [n for n in of if n.family == family]
            bars = [n.bar for n in points]
            lines.append(Line(bars, [max(n.error, 1e-9) for n in points], style="o", label=family))
        panels.append(Panel(lines, log="xy", title=way, x="error bar [-]", y="true error [-]"))
    return line_figure(
        [panels],
        "Below the line a bar covers; as far below it as the bar is too wide.",
        shares_legend=True,
    )
