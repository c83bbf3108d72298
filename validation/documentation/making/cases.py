"""A page for each built-in case, made from its file and its stored truth, and their list."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from making.look_up import table
from palpate.meshes.problem import Strain
from palpate.validation.case import Case, builtin_cases, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.judging.expectation import Expectation, read_expected
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.stored import load_stored
from palpate.validation.report.pictures import draw_case


def write_cases(made: Path) -> None:
    """One page for each built-in case, and their list."""
    expected = read_expected()
    rows: list[tuple[str, ...]] = []
    distances: list[tuple[str, ...]] = []
    for name in builtin_cases():
        case, known = load_case(name), expected.get(name, {})
        (made / "cases" / f"{name}.md").write_text(_page(case, known), "utf-8")
        distances += _distances(case, known)
        verdicts = [str(says.verdict) for says in known.values()]
        rows.append((f"[{name}](cases/{name}.md)", case.title, *[*verdicts, "-", "-"][:2]))
    names = "\n".join(f"cases/{name}" for name in builtin_cases())
    text = (
        "# Built-in cases\n\nEach with its source, what its user needs, its truth, and the verdict "
        "on fastsim with linear and with smoothed tetrahedra, which `palpate gate --all --element "
        "both --expected` holds it to: it ends with 0 while nothing has changed, and with 1 when "
        "something did, either way. A case on which linear tetrahedra fail is not broken: it shows "
        "what they cannot do.\n\n"
        + table(("case", "what", "linear", "smoothed"), rows)
        + "\n## How far fastsim is from the truth\n\nAt most, by the regression bounds of "
        "`expected.toml` (what was measured and 2 % of it), beside the truth's own error bar and "
        "what the case's user needs.\n\n"
        + table(("case", "error of", "linear", "smoothed", "bar", "need"), distances)
        + f"\n```{{toctree}}\n:hidden:\n{names}\n```\n"
    )
    (made / "cases.md").write_text(text, encoding="utf-8")


def draw_cases(made: Path) -> None:
    """The picture of each."""
    for name in builtin_cases():
        draw_case(load_case(name), made / "cases" / f"{name}.png")


def _page(case: Case, expected: Mapping[str, Expectation]) -> str:
    truth = load_stored(case.name, case.problem)
    shown = f"{case.title}: its body, what is fixed, and what pushes"
    verdicts = [
        (candidate, str(says.verdict), "; ".join([*says.failed, *says.inconclusive]) or "-")
        for candidate, says in expected.items()
    ]
    bounds = [
        (candidate, name, f"{bound:.3g}")
        for candidate, says in expected.items()
        for name, bound in says.regression_bound.items()
    ]
    parts = [
        f"# {case.name}: {case.title}\n",
        f"{case.spec.description}\n" if case.spec.description else "",
        f"![{shown}]({case.name}.png)\n",
        "\n".join(_heading_comment(case.text)) + "\n",
        "## What it is for\n",
        "\n\n".join(_use(case)) + "\n",
        "## Numbers\n",
        table(("of the body", "value"), _numbers(case)),
        "\n## What is checked\n",
        "An error is divided by its scale (see [metrics](../metrics.md)); 0.05 is five per cent.\n",
        table(("metric", "against", "limit", "reason"), [_check(c) for c in case.spec.check]),
        "\n## Its truth\n",
        f"{truth.origin[0].upper()}{truth.origin[1:]}.\n",
        table(("of the truth", "strain", "value"), _values(case, truth)),
        "",
        table(("error bar of", "strain", "relative to its scale"), _bars(truth)),
        "\n## What fastsim reaches\n",
        table(("with", "verdict", "what is not passed"), verdicts),
        "\nWhat its errors against the truth may be at most before CI calls it worse: each is what "
        "was measured and 2 % of it. By these nothing passes.\n",
        table(("with", "error", "at most"), bounds),
        f"\n## The file\n\n```toml\n{case.text.strip()}\n```\n",
    ]
    return "\n".join(part for part in parts if part)


def _heading_comment(text: str) -> list[str]:
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if not line.startswith("#:"):
            lines.append(line.removeprefix("#").strip())
    return lines


def _use(case: Case) -> Iterator[str]:
    said = case.spec.evidence
    yield f"**{said.question}** {said.context_of_use}"
    if said.quantities_of_interest:
        yield f"What is read from it: {said.quantities_of_interest.rstrip('.')}."
    if said.applicability:
        yield f"How near it is to that use. {said.applicability}"


def _numbers(case: Case) -> Iterator[tuple[str, str]]:
    problem, units = case.problem, case.spec.units
    mesh, material = problem.mesh, problem.material
    to_length = 1.0 / units.metres(1.0)
    size = (mesh.points.max(axis=0) - mesh.points.min(axis=0)) * to_length
    yield "size", " x ".join(f"{one:.4g}" for one in size) + f" {units.length}"
    volume = mesh.volume * to_length**3
    yield "volume", f"{volume:.6g} {units.length}³"
    yield "mesh", f"{mesh.num_points} points, {mesh.num_cells} tetrahedra"
    yield "law", f"{material.law}, {case.spec.strain} strain"
    yield "Young's modulus", f"{material.youngs_modulus:.6g} Pa"
    yield "Poisson's ratio", f"{material.poissons_ratio:.6g}"
    yield "density", f"{material.density:.6g} kg/m³"
    if problem.time is not None:
        yield "motion", f"{problem.time.end_time:g} s"


def _check(check: CheckSpec) -> tuple[str, str, str, str]:
    named = f"`{check.metric}`"
    details = [str(x) for x in (check.strain, check.component, check.quantity) if x is not None]
    if check.expected is not None:
        details.append(f"expected {check.expected:g}")
    against = str(check.against).replace("_", " ")
    return " ".join([named, *details]), against, f"`{check.limit:g}`", check.reason


def _values(case: Case, truth: ReferenceSet) -> Iterator[tuple[str, str, str]]:
    mesh, units = case.problem.mesh, case.spec.units
    rest_volume, rest_area = mesh.volume, mesh.surface_area
    for strain in Strain:
        state = truth.truth(strain)
        if state is None:
            continue
        moved = f"{state.max_displacement / units.metres(1.0):.5g} {units.length}"
        at = "largest displacement" + (" at the end" if state.trajectory is not None else "")
        yield at, str(strain), moved
        for name, value, rest in (
            ("volume", state.volume, rest_volume), ("area", state.surface_area, rest_area),
        ):  # fmt: skip
            yield f"change of {name}", str(strain), f"{100 * (value / rest - 1):+.4g} %"


def _bars(truth: ReferenceSet) -> Iterator[tuple[str, str, str]]:
    for (metric, strain), bar in sorted(truth.bars.items(), key=lambda item: item[0]):
        name, _, part = metric.partition("@")
        where = f"`{name}`" + (" of the part or number that a check names" if part else "")
        shown = "none" if not math.isfinite(bar) else f"{bar:.2g}"
        yield where, str(strain), shown


def _distances(case: Case, expected: Mapping[str, Expectation]) -> Iterator[tuple[str, ...]]:
    """Of each check against the truth, in per cent: case, metric, both elements, bar, need."""
    bounds: dict[str, float] = {}
    for says in expected.values():
        bounds |= says.regression_bound
    bars = load_stored(case.name, case.problem).bars
    for check in case.spec.check:
        strain = check.strain or case.spec.strain
        linear = bounds.get(f"{check.metric} (truth, {strain})")
        if check.against != "truth" or check.expected is not None or linear is None:
            continue
        smoothed = bounds.get(f"{check.metric} (truth, {strain}, smoothed)")
        of_parts = [
            bar
            for (name, of), bar in bars.items()
            if of is strain and name.partition("@")[0] == check.metric
        ]
        bar = of_parts[0] if len(of_parts) == 1 else None
        numbers = (linear, smoothed, bar, check.limit)
        shown = ["-" if one is None else f"{100 * one:.2g} %" for one in numbers]
        yield (case.name, f"`{check.metric}`", *shown)
