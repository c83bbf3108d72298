"""A sweep as a folder: a table, figures for a paper, and one page."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import cycle, pairwise, product
from pathlib import Path
from typing import Any

from rich.console import Console

from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.case.variants import Axis, variants
from palpate.validation.report.answer import key_in_words
from palpate.validation.report.comparisons import STRAIN_NAMES
from palpate.validation.report.plots import COLOURS, Figure, Line, Panel, line_figure
from palpate.validation.report.study_page import Finding, Page, Table, judged, leave
from palpate.validation.solving import Simulator
from palpate.validation.states import Progress, Verdict
from palpate.validation.studies.sweep_runs import Run, difference, linear_error, run_all

# Figures of a sweep: what the result does along the first axis.

Measured = Callable[[Run], float | None]
# Error of linear strain that is asked about where the case's checks state no need of theirs.
_USUAL = 0.05


def _needs(case: Case) -> tuple[float, bool]:
    """The least limit of displacement against the truth, and whether the case states one."""
    needs = [
        spec.limit
        for spec in case.checks
        if (spec.metric, spec.against) == ("displacement_l2", "truth")
    ]
    return min(needs, default=_USUAL), bool(needs)


def sweep_figures(
    axes: Sequence[Axis], runs: Sequence[Run], case: Case, folder: Path
) -> dict[str, Figure]:
    """Displacement, volume, and linear against Green strain; each as NAME.pdf in a folder too."""
    unit = case.spec.units.length
    made: dict[str, tuple[str, Measured, str]] = {
        "displacement": (
            f"largest displacement of a point [{unit}]",
            lambda run: run.state.max_displacement / LENGTH[unit] if run.state else None,
            "Largest displacement of a point. Solid: Green strain; dashed: linear strain.",
        ),
        "volume": (
            "volume [% of that at rest]",
            lambda run: 100.0 * run.state.volume / case.mesh.mesh.volume if run.state else None,
            "Deformed volume. Linear strain swells where a body turns.",
        ),
        "linear-error": (
            "error of linear strain [%]",
            lambda run: _percent(linear_error(run, runs)) if run.strain is Strain.LINEAR else None,
            "What linear strain costs: its displacement less that of Green strain, in L2.",
        ),
    }
    if any(axis.key.startswith(("geometry.", "mesh.")) for axis in axes):
        del made["volume"]  # there is no one rest volume
    figures = {}
    for name, (words, measure, caption) in made.items():
        lost = [run for run in runs if run.was_tried and run.state is None]
        is_error = name == "linear-error"
        panel = Panel(
            lines_of(axes, runs, measure),
            levels={100.0 * _needs(case)[0]: "allowed"} if is_error else (),
            y_range=(0.0, None) if is_error else (None, None),
            # Where the first value without a result is.
            positions={run.values[0]: f"no result, {STRAIN_NAMES[run.strain]}" for run in lost},
            x=_in_words(axes[0].key, case),
            y=words,
        )
        pdf = folder / f"{name}.pdf"
        figures[name] = line_figure([[panel]], caption, shares_legend=False, pdf=pdf)
    return figures


def _percent(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def _named(simulator: Simulator | str, element: Element) -> str:
    """Who solved, with its element where it is not the linear one."""
    return f"{simulator}, {element} tetrahedra" if element is not Element.LINEAR else str(simulator)


def _in_words(key: str, case: Case) -> str:
    """A key of the case as the name of an axis, with its unit where its last word says it."""
    if found := re.fullmatch(r"load\[(\d+)\]\.factor", key):
        return f"load {int(found[1]) + 1}, times that of the case [-]"
    units, last = case.spec.units, re.sub(r"\[\d+\]$", "", key).rpartition(".")[2]
    known = {
        "youngs_modulus": units.stress, "pressure": units.stress, "traction": units.stress,
        "poissons_ratio": "-", "density": "kg/m³", "force": "N", "moment": "N m",
        "acceleration": "m/s²", "time_step": "s", "end_time": "s", "mass_damping": "1/s",
        "edge_length": units.length, "size": units.length, "radius": units.length,
    }  # fmt: skip
    return f"{key} [{known[last]}]" if last in known else key


def lead_of(axes: Sequence[Axis], runs: Sequence[Run], case: Case) -> str:
    """Up to which value linear strain may stand in for Green's, by the largest error of a row.

    The limit is that of the case's check of displacement against the truth. "" in a motion, and
    where nothing was solved with both.
    """
    if case.problem.time is not None:
        return ""
    limit, is_stated = _needs(case)
    worst: dict[float, float] = {}
    for run in runs:
        if run.strain is Strain.LINEAR and (off := linear_error(run, runs)) is not None:
            worst[run.values[0]] = max(off, worst.get(run.values[0], 0.0))
    if not worst:
        return ""
    key, tested = key_in_words(axes[0].key), sorted(worst, key=abs)
    allowed = f"allowed: {100.0 * limit:g} %"
    allowed += "" if is_stated else ", since the case states no need"
    good = [value for value in tested if worst[value] <= limit]
    if axes[0].is_load:  # more of it is more error: what lies beyond the first excess is no more
        good = tested[: next((k for k, v in enumerate(tested) if worst[v] > limit), len(tested))]
    if not good:
        least = min(worst, key=lambda value: worst[value])
        return (
            f"Linear strain may not stand in for Green's at any value of the {key} that was "
            f"tried: it is {100.0 * worst[least]:.3g} % off at least, at {least:g} ({allowed})."
        )
    if len(good) == len(tested):
        most = max(worst, key=lambda value: worst[value])
        return (
            f"Linear strain may stand in for Green's at every value of the {key} that was "
            f"tried: it is {100.0 * worst[most]:.2g} % off at most, at {most:g} ({allowed})."
        )
    bad = next(value for value in tested if value not in good)
    where = f"up to a {key} of {good[-1]:g}" if axes[0].is_load else (
        f"at a {key} of {', '.join(f'{value:g}' for value in sorted(good))}"
    )  # fmt: skip
    return (
        f"Linear strain may stand in for Green's {where} "
        f"({100.0 * max(worst[value] for value in good):.2g} % off; {allowed}), not at {bad:g} "
        f"({100.0 * worst[bad]:.3g} %)."
    )


def lines_of(axes: Sequence[Axis], runs: Sequence[Run], measure: Measured) -> list[Line]:
    """A colour for each element and values of the other axes; fastsim as lines, others crosses."""
    lines = []
    others = list(dict.fromkeys(run.values[1:] for run in runs))
    elements = list(dict.fromkeys(run.element for run in runs))
    colours = dict(zip(product(others, elements), cycle(COLOURS), strict=False))
    simulators = dict.fromkeys(run.simulator for run in runs)
    for wanted in product(others, elements, simulators, Strain):
        rows = sorted(
            (run.values[0], value)
            for run in runs
            if (run.values[1:], run.element, run.simulator, run.strain) == wanted
            and (value := measure(run)) is not None
        )
        if not rows:
            continue
        other, element, simulator, strain = wanted
        x, y = zip(*rows, strict=True)
        more = [f"{a.key} = {v:g}" for a, v in zip(axes[1:], other, strict=True)]
        style = "-o" if strain is Strain.GREEN else "--o"
        lines.append(
            Line(
                x,
                y,
                label="; ".join([f"{_named(simulator, element)}, {STRAIN_NAMES[strain]}", *more]),
                style=style if simulator is Simulator.FASTSIM else "x",
                colour=colours[other, element],
            )
        )
    return lines


# Same mesh, same equations: what the solvers leave (README).
_SOLVER_ERROR = 1e-8


def sweep(
    case: Case,
    axes: Sequence[Axis],
    folder: Path,
    console: Console,
    *,
    simulators: Sequence[Simulator | OutsideSimulator] = (Simulator.FASTSIM,),
    elements: Sequence[Element] = (Element.LINEAR,),
    device: str = "cpu",
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress,
) -> int:
    """Solve, and leave sweep.csv, figures (SVG, PDF), report.html and results.json.

    Returns:
        0; 1 where no value has a result, or fastsim and the reference differ; 3 where another load
        or the other strain measure has the same result.

    Raises:
        InputError: See `variants` and `cluster`.
    """
    runs = run_all(
        axes,
        variants(case, axes),
        simulators,
        elements=elements,
        device=device,
        jobs=jobs,
        scheduler=scheduler,
        progress=progress,
    )
    ends = [*ends_of(axes, runs), *sames_of(axes, runs)]
    for line in ends:
        console.print(line, markup=False, soft_wrap=True)
    unit = case.spec.units.length
    table = _table(axes, runs, unit)
    about = [
        f"{case.title}. {len(runs)} runs on {case.mesh.mesh.num_cells} cells "
        f"({case.mesh.origin}) unless the body itself varies; "
        f"{' and '.join(elements)} tetrahedra.",
        f"For which use: {case.spec.evidence.context_of_use or 'not stated'}",
        *ends,
    ]
    return leave(
        folder,
        console,
        name="sweep",
        title=f"Sweep of {case.name}: {', '.join(key_in_words(axis.key) for axis in axes)}",
        about=about,
        findings=_findings(axes, runs),
        page=Page(
            figures=sweep_figures(axes, runs, case, folder),
            tables={"sweep": table},
            lead=lead_of(axes, runs, case),
            numbers={
                "case": case.name,
                "elements": [str(element) for element in elements],
                "axes": {axis.key: list(axis.values) for axis in axes},
            },
        ),
    )


def ends_of(axes: Sequence[Axis], runs: Sequence[Run]) -> list[str]:
    """Where there is no result, a line each, with the last value that has one."""
    lines = []
    for run in runs:
        if run.state is not None or not run.was_tried:
            continue
        position = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes, run.values, strict=True))
        line = f"{run.who}, {run.strain} strain: no solution at {position}: {run.trouble}"
        before = [
            other.values[0]
            for other in runs
            if other.state is not None
            and (other.who, other.strain, other.values[1:]) == (run.who, run.strain, run.values[1:])
            and other.values[0] * run.values[0] >= 0.0
            and abs(other.values[0]) < abs(run.values[0])
        ]
        if axes[0].is_load and before:
            line += f"; the last that has one is {axes[0].key} = {max(before, key=abs):g}"
        lines.append(line)
    return lines


# Results of one solve, rounded: relative L2 of displacement [-].
_IDENTICAL = 1e-12


def _are_same(one: Run, other: Run) -> bool:
    if one.state is None or other.state is None:
        return False
    is_on_one_mesh = one.state.displacement.shape == other.state.displacement.shape
    return is_on_one_mesh and difference(one.state, other.state) <= _IDENTICAL


def _neighbours(runs: Sequence[Run], k: int) -> list[tuple[Run, Run]]:
    """Neighbours along an axis that have a result each, all else being equal."""
    rows: dict[object, list[Run]] = {}
    solved = (run for run in runs if run.state is not None)
    for run in sorted(solved, key=lambda run: run.values[k]):
        others = (*run.values[:k], *run.values[k + 1 :])
        rows.setdefault((others, run.who, run.strain), []).append(run)
    return [pair for row in rows.values() for pair in pairwise(row)]


def _same_along(runs: Sequence[Run], k: int) -> list[tuple[Run, Run]]:
    return [pair for pair in _neighbours(runs, k) if _are_same(*pair)]


def _same_strains(runs: Sequence[Run]) -> list[tuple[Run, Run]]:
    """Results that move, and are the same under linear and Green strain."""
    return [
        (run, other)
        for run in runs
        for other in runs
        if run.strain is Strain.LINEAR and other.strain is Strain.GREEN
        and (run.values, run.who) == (other.values, other.who)
        and run.state is not None and run.state.max_displacement > 0.0
        and _are_same(run, other)
    ]  # fmt: skip


def sames_of(axes: Sequence[Axis], runs: Sequence[Run]) -> list[str]:
    """Where another value, or the other strain measure, has the same result, a line each."""
    lines = []
    for k, axis in enumerate(axes):
        for one, other in _same_along(runs, k):
            where = f"{axis.key} = {one.values[k]:g} and {other.values[k]:g}"
            lines.append(
                f"{one.who}, {one.strain} strain: the same result at {where}: it has no effect "
                "on this case, or the simulator ignores it"
            )
    for one, _ in _same_strains(runs):
        where = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes, one.values, strict=True))
        lines.append(
            f"{one.who}: linear and Green strain have the same result at {where}: nothing is "
            "strained there, or the simulator ignores the strain measure"
        )
    return lines


# A simulator ignores what moves its result by less than this part of what it moves fastsim's.
_IGNORES, _MOVES = 0.01, 1e-6


def ignored_by(axes: Sequence[Axis], runs: Sequence[Run]) -> list[str]:
    """What other simulators ignore though fastsim's result depends on it, a line each."""
    ours = {
        (run.values, run.element, run.strain): run.state
        for run in runs
        if run.simulator is Simulator.FASTSIM and run.state is not None
    }

    def is_ignored(one: Run, other: Run) -> bool:
        mine, theirs = (ours.get((r.values, r.element, r.strain)) for r in (one, other))
        if mine is None or theirs is None or one.state is None or other.state is None:
            return False
        moved = difference(mine, theirs)
        return moved > _MOVES and difference(one.state, other.state) <= _IGNORES * moved

    others = [run for run in runs if not isinstance(run.simulator, Simulator)]
    lines = []
    for k, axis in enumerate(axes):
        for one, other in _neighbours(others, k):
            if is_ignored(one, other):
                where = f"{axis.key} = {one.values[k]:g} and {other.values[k]:g}"
                lines.append(f"{one.who}, {one.strain} strain, ignores {where}")
    for one, other in product(others, others):
        of_both = one.strain is Strain.LINEAR and other.strain is Strain.GREEN
        if (
            of_both
            and (one.values, one.who) == (other.values, other.who)
            and is_ignored(one, other)
        ):
            where = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes, one.values, strict=True))
            lines.append(f"{one.who} ignores the strain measure at {where}")
    return lines


def finding_on_sames(axes: Sequence[Axis], runs: Sequence[Run]) -> list[Finding]:
    """Whether more load, and the other strain measure, change the results, where loads vary."""
    loads = [k for k, axis in enumerate(axes) if axis.is_load]
    if not loads:
        return []
    same = [pair for k in loads for pair in _same_along(runs, k)]
    alike = _same_strains(runs)
    found = f"the same result at {len(same)} pairs of loads, and {len(alike)} times in both strains"
    verdict = Verdict.INCONCLUSIVE if same or alike else Verdict.PASSED
    return [
        Finding("another load, and the other strain measure, change the result", found, verdict)
    ]


def _findings_on_others(axes: Sequence[Axis], runs: Sequence[Run]) -> list[Finding]:
    """Whether other simulators solve at some value, and take what they are asked for."""
    others = [run for run in runs if not isinstance(run.simulator, Simulator)]
    if not others:
        return []
    count = sum(run.state is not None for run in others)
    lines = ignored_by(axes, runs)
    found = "; ".join(lines[:3]) + (f"; and {len(lines) - 3} more" if len(lines) > 3 else "")
    claim = f"{others[0].simulator} takes the values and the strain measure that it is asked for"
    return [
        judged(f"{others[0].simulator} has a result", f"{count} of {len(others)} runs", count > 0),
        judged(claim, found or "it moves where fastsim does", not lines),
    ]


def _findings(axes: Sequence[Axis], runs: Sequence[Run]) -> list[Finding]:
    num_results = sum(run.state is not None for run in runs)
    findings = [
        judged("some value has a result", f"{num_results} of {len(runs)} runs", num_results > 0),
        *finding_on_sames(axes, runs),
        *_findings_on_others(axes, runs),
    ]
    differences = [
        (difference(run.state, other.state), run)
        for run in runs
        for other in runs
        if run.simulator is Simulator.FASTSIM
        and other.simulator is Simulator.REFERENCE
        and (run.values, run.element, run.strain) == (other.values, other.element, other.strain)
        and run.state is not None
        and other.state is not None
    ]
    if differences:
        worst = max(value for value, _ in differences)
        findings.append(
            judged(
                "fastsim and the reference agree on the same mesh, at every value",
                f"relative L2 difference of displacement at most {worst:.1e} over "
                f"{len(differences)} pairs, limit {_SOLVER_ERROR:g}",
                worst <= _SOLVER_ERROR,
            )
        )
    return findings


def _table(axes: Sequence[Axis], runs: Sequence[Run], unit: str) -> Table:
    scale = LENGTH[unit]
    rows: list[tuple[Any, ...]] = []
    for run in runs:
        head = (*run.values, str(run.simulator), str(run.element), str(run.strain))
        state = run.state
        if state is None:
            rows.append((*head, *(None,) * 6, run.trouble))
            continue
        rows.append(
            (
                *head,
                state.max_displacement / scale,
                state.volume / scale**3,
                state.surface_area / scale**2,
                state.smallest_det_f,
                linear_error(run, runs) if run.strain is Strain.LINEAR else None,
                state.seconds,
                "",
            )
        )
    columns = {
        **{axis.key: ".10g" for axis in axes},
        "simulator": "",
        "element": "",
        "strain": "",
        f"max displacement [{unit}]": ".5g",
        f"volume [{unit}3]": ".7g",
        f"surface area [{unit}2]": ".7g",
        "smallest det F [-]": ".6g",
        "linear - Green, of Green's displacement [-]": ".4g",
        "seconds": ".3g",
        "no result because": "",
    }
    return Table("Every run", columns, rows)
