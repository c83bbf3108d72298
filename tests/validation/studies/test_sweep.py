"""`palpate sweep`: values by their path, both strains, honest ends, a folder for a paper."""

from __future__ import annotations

import csv
import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case import load_case
from palpate.validation.case.variants import VaryError, read_axis, variants
from palpate.validation.exchange.nodal_arrays import nodal_force
from palpate.validation.peers import adapters
from palpate.validation.solving import Simulator, solve
from palpate.validation.states import Verdict, in_silence
from palpate.validation.studies.sweep import (
    ends_of,
    finding_on_sames,
    ignored_by,
    lead_of,
    sames_of,
)
from palpate.validation.studies.sweep_runs import Run, linear_error, run_all

Command = Callable[..., subprocess.CompletedProcess[str]]
NEED = ("displacement_l2", "truth")


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "sweep.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("load[0].factor=0.5:2:4", (0.5, 1.0, 1.5, 2.0)),
        ("material.poissons_ratio=0.3,0.4", (0.3, 0.4)),
        ("load[0].force[1] = -5", (-5.0,)),
        ("support[0].region.half_space.point[0]=0.001,0.002", (0.001, 0.002)),
    ],
)
def test_values_are_read(
    write_case: Callable[..., Path], words: str, values: tuple[float, ...]
) -> None:
    assert read_axis(words, load_case(write_case())).values == pytest.approx(values)


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        ("material.poisons_ratio=0.3", "did you mean 'material.poissons_ratio'"),
        ("load[1].factor=1:2:3", "did you mean 'load[0].factor'"),
        ("load[0].force=1", "did you mean 'load[0].force["),
        ("material.poissons_ratio", "write KEY="),
        ("material.poissons_ratio=", "write KEY="),
        ("material.poissons_ratio=0.3,x", "write numbers"),
        ("material.poissons_ratio=__import__('os')", "write numbers"),
        ("material.poissons_ratio=2*0.1", "write numbers"),
        ("material.poissons_ratio=0.1:0.2", "write numbers"),
        ("material.poissons_ratio=0.1:0.2:1", "a count from 2"),
        ("material.poissons_ratio=0.1:0.2:999999999", "a count from 2"),
        ("material.poissons_ratio=nan", "finite"),
        ("material.poissons_ratio=0.3,0.3", "twice"),
    ],
)
def test_what_cannot_vary_is_reported_with_what_was_meant(
    write_case: Callable[..., Path], words: str, reported: str
) -> None:
    with pytest.raises(VaryError) as caught:
        read_axis(words, load_case(write_case()))
    assert reported in str(caught.value)


def test_every_combination_is_built_on_one_mesh_and_a_bad_value_is_reported_before_any_solve(
    write_case: Callable[..., Path],
) -> None:
    case = load_case(write_case())
    words = ["load[0].factor=1,2,3", "material.poissons_ratio=0.3,0.4"]
    found = variants(case, [read_axis(w, case) for w in words])
    assert [v.values for v in found] == [
        (1.0, 0.3), (1.0, 0.4), (2.0, 0.3), (2.0, 0.4), (3.0, 0.3), (3.0, 0.4),
    ]  # fmt: skip
    last = found[-1].case.problem
    assert last.material.poissons_ratio == 0.4
    (load,) = last.loads
    assert isinstance(load, Traction)
    # 3 x (60, 20, -10) N on 1 m2.
    assert load.traction == pytest.approx((180.0, 60.0, -30.0))
    assert all(v.case.problem.mesh is case.problem.mesh for v in found)
    with pytest.raises(InputError, match=r"poissons_ratio = 0\.6"):
        variants(case, [read_axis("material.poissons_ratio=0.3,0.6", case)])
    axis = read_axis("load[0].factor=1,2", case)
    with pytest.raises(VaryError, match="twice"):
        variants(case, [axis, axis])
    many = dataclasses.replace(axis, values=tuple(range(1, 9000)))
    other = read_axis("material.poissons_ratio=0.3,0.4", case)
    with pytest.raises(InputError, match="combinations"):
        variants(case, [many, other])


@pytest.mark.parametrize(
    "load",
    [
        'kind = "moment"\nmoment = [0.0, 5.0, 0.0]',
        'kind = "traction"\nvalues = [{ at = [2, 0, 0], traction = [0, 0, 1] }, '
        "{ at = [2, 1, 0], traction = [0, 0, 8] }]",
    ],
)
def test_the_factor_of_a_load_that_varies_over_its_face(
    write_case: Callable[..., Path], load: str
) -> None:
    case = load_case(write_case(('kind = "force"\nforce = [60.0, 20.0, -10.0]', load)))
    mesh = case.problem.mesh
    once, thrice = (
        nodal_force(mesh, found.case.problem.loads[0])
        for found in variants(case, [read_axis("load[0].factor=1,3", case)])
    )
    assert np.abs(once).max() > 0.0
    np.testing.assert_allclose(thrice, 3.0 * once, atol=1e-12 * np.abs(once).max())


def test_another_mesh_is_made_where_the_body_varies(write_case: Callable[..., Path]) -> None:
    case = load_case(write_case())
    small, large = variants(case, [read_axis("geometry.size[1]=1,2", case)])
    assert large.case.problem.mesh.volume == pytest.approx(2.0 * small.case.problem.mesh.volume)


@pytest.mark.parametrize("jobs", [1, 3])
def test_a_solution_of_a_sweep_is_that_of_the_case_alone(
    write_case: Callable[..., Path], jobs: int
) -> None:
    case = load_case(write_case())
    axes = [read_axis("load[0].factor=0.5,1", case)]
    runs = run_all(axes, variants(case, axes), [Simulator.FASTSIM], jobs=jobs, progress=in_silence)
    assert [(r.values[0], r.strain) for r in runs] == [
        (0.5, Strain.LINEAR), (1.0, Strain.LINEAR), (0.5, Strain.GREEN), (1.0, Strain.GREEN),
    ]  # fmt: skip
    whole = runs[3].state
    assert whole is not None
    np.testing.assert_array_equal(whole.displacement, solve(case.problem).displacement)
    half, full = runs[0].state, runs[1].state
    assert half is not None
    assert full is not None
    # Linear strain: half the load, half the displacement.
    np.testing.assert_allclose(
        2.0 * half.displacement, full.displacement, atol=1e-8 * full.max_displacement
    )
    errors = [linear_error(run, runs) for run in runs[:2]]
    assert errors[0] is not None
    assert errors[1] is not None
    assert 0.0 < errors[0] < errors[1]


def test_it_stops_where_equilibrium_ends_and_says_at_which_value(
    write_case: Callable[..., Path],
) -> None:
    # A bar of E A = 1000 N pressed by P = E A / 2 (s - s^3) carries at most E A / (3 sqrt(3)) =
    # 192 N, at s = 1/sqrt(3); ten times 20 N is more.
    case = load_case(write_case(("force = [60.0, 20.0, -10.0]", "force = [-20.0, 0.0, 0.0]")))
    axes = [read_axis("load[0].factor=0.5,1,20,10", case)]
    runs = run_all(axes, variants(case, axes), [Simulator.FASTSIM], progress=in_silence)
    green = {r.values[0]: r for r in runs if r.strain is Strain.GREEN}
    assert list(green) == [0.5, 1.0, 10.0, 20.0]
    assert green[1.0].state is not None
    assert green[10.0].state is None
    assert green[10.0].was_tried
    assert not green[20.0].was_tried
    assert green[20.0].trouble == "not tried: no solution at load[0].factor = 10"
    assert all(r.state is not None for r in runs if r.strain is Strain.LINEAR)
    (reported,) = ends_of(axes, runs)
    assert "no solution at load[0].factor = 10" in reported
    assert reported.endswith("the last that has one is load[0].factor = 1")


def test_the_same_result_for_other_values_or_the_other_strain_is_said_and_shows_nothing(
    write_case: Callable[..., Path],
) -> None:
    case = load_case(write_case())
    axes = [read_axis("load[0].factor=0.5,1,2", case)]
    runs = run_all(axes, variants(case, axes), [Simulator.FASTSIM], progress=in_silence)
    assert sames_of(axes, runs) == []
    (right,) = finding_on_sames(axes, runs)
    assert right.verdict is Verdict.PASSED

    def sends(chosen: Callable[[Run], Run]) -> tuple[list[str], Verdict]:
        alike = [dataclasses.replace(run, state=chosen(run).state) for run in runs]
        (finding,) = finding_on_sames(axes, alike)
        return sames_of(axes, alike), finding.verdict

    def run_of(load: float, strain: Strain) -> Run:
        return next(run for run in runs if (run.values[0], run.strain) == (load, strain))

    # At every load; from some load on; the same for both strains.
    lines, verdict = sends(lambda run: run_of(1.0, run.strain))
    assert verdict is Verdict.INCONCLUSIVE
    assert len(lines) == 4
    assert "the same result at load[0].factor = 0.5 and 1" in lines[0]
    lines, verdict = sends(lambda run: run_of(min(run.values[0], 1.0), run.strain))
    assert verdict is Verdict.INCONCLUSIVE
    assert len(lines) == 2
    assert all("load[0].factor = 1 and 2" in line for line in lines)
    lines, verdict = sends(lambda run: run_of(run.values[0], Strain.GREEN))
    assert verdict is Verdict.INCONCLUSIVE
    assert len(lines) == 3
    assert all("linear and Green strain have the same result" in line for line in lines)


# Somebody's program: an adapter, for another problem than it is asked for.
WRAPPED = """
import json, runpy, sys
from pathlib import Path
import numpy as np
case = Path(sys.argv[1])
given, rest = json.loads((case / "case.json").read_text()), dict(np.load(case / "rest.npz"))
load = np.abs(rest["external_force"].sum(axis=0)).max()
{change}
(case / "case.json").write_text(json.dumps(given))
np.savez(case / "rest.npz", **rest)
runpy.run_path({adapter!r}, run_name="__main__")
"""


@pytest.mark.parametrize(
    ("change", "ignored"),
    [
        ("", []),
        # One load whatever is asked for; none beyond some load; one strain measure for both.
        ("rest['external_force'] *= 20.0 / load",
         ["load[0].factor = 0.5 and 1", "load[0].factor = 1 and 2"]),
        ("rest['external_force'] *= min(1.0, 60.0 / load)",
         ["load[0].factor = 1 and 2"]),
        ("given['strain'] = 'linear'", ["the strain measure at load[0].factor = 1"]),
    ],
)  # fmt: skip
def test_another_simulator_that_ignores_what_it_is_asked_for_fails(
    tmp_path: Path, write_case: Callable[..., Path], change: str, ignored: list[str]
) -> None:
    adapter = Path(adapters.__file__).parent / "numpy_dense.py"
    text = WRAPPED.format(change=change, adapter=str(adapter))
    (tmp_path / "wrapped.py").write_text(text, "utf-8")
    program = OutsideSimulator(f"{sys.executable} {tmp_path / 'wrapped.py'} {{case}} {{result}}")
    case = load_case(write_case())
    axes = [read_axis("load[0].factor=0.5,1,2", case)]
    simulators = [Simulator.FASTSIM, program]
    runs = run_all(axes, variants(case, axes), simulators, progress=in_silence)
    lines = ignored_by(axes, runs)
    for words in ignored:
        assert any(words in line and "wrapped (simulator)" in line for line in lines), lines
    assert bool(lines) == bool(ignored)


def test_a_value_without_effect_is_said(write_case: Callable[..., Path]) -> None:
    weight = ("poissons_ratio = 0.3", "poissons_ratio = 0.3\ndensity = 1000.0")
    case = load_case(write_case(weight))
    axes = [read_axis("material.density=900,1000", case)]
    runs = run_all(axes, variants(case, axes), [Simulator.FASTSIM], progress=in_silence)
    assert all("it has no effect on this case" in line for line in sames_of(axes, runs))
    assert len(sames_of(axes, runs)) == 2
    assert finding_on_sames(axes, runs) == []  # no load varies


def test_a_sweep_leaves_a_table_vector_figures_and_a_page(
    palpate_run: Command, tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    folder = tmp_path / "out"
    done = palpate_run(
        "sweep", write_case(), "--vary", "load[0].factor=0.5:2:3",
        "--vary", "material.poissons_ratio=0.3,0.4", "-o", folder, "--jobs", 2,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = rows_of(folder)
    assert len(rows) == 3 * 2 * 2
    assert {r["load[0].factor"] for r in rows} == {"0.5", "1.25", "2"}
    for stem in ("displacement", "volume", "linear-error"):
        assert "<svg" in (folder / f"{stem}.svg").read_text("utf-8")
        assert (folder / f"{stem}.pdf").read_bytes().startswith(b"%PDF")
    page = (folder / "report.html").read_text("utf-8")
    assert page.count("<svg") == 3
    assert "Sweep of block: factor of load 1, Poisson&#39;s ratio" in page
    assert "For which use: not stated" in page


@pytest.mark.long
def test_each_element_gives_the_solution_of_the_case_alone_and_is_named(
    palpate_run: Command, tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    folder, case = tmp_path / "out", write_case()
    vary = ("--vary", "load[0].factor=0.5,1")
    done = palpate_run("sweep", case, *vary, "--element", "both", "-o", folder)
    assert done.returncode == 0, done.stderr
    rows = {(r["element"], r["strain"], r["load[0].factor"]): r for r in rows_of(folder)}
    assert len(rows) == 2 * 2 * 2
    moved = "max displacement [m]"
    for element in Element:
        alone = solve(load_case(case).problem, element=element)
        row = rows[str(element), "green", "1"]
        assert float(row[moved]) == pytest.approx(alone.max_displacement, rel=1e-7)
        # What linear strain costs is told of the same element: it vanishes with the load.
        errors = [
            float(rows[str(element), "linear", load]["linear - Green, of Green's displacement [-]"])
            for load in ("0.5", "1")
        ]
        assert 0.0 < errors[0] < errors[1]
    page = (folder / "report.html").read_text("utf-8")
    assert "linear and smoothed tetrahedra" in page
    assert "fastsim, smoothed tetrahedra, Green strain" in (folder / "displacement.svg").read_text(
        "utf-8"
    )
    smoothed = tmp_path / "smoothed"
    done = palpate_run("sweep", case, *vary, "--element", "smoothed", "-o", smoothed)
    assert done.returncode == 0, done.stderr
    assert {r["element"] for r in rows_of(smoothed)} == {"smoothed"}


def test_nothing_is_left_by_a_bad_key_and_no_solution_is_none(
    palpate_run: Command, tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    case = write_case(('[[check]]\nmetric = "displacement_l2"', '[[check]]\nmetric = "volume"'))
    done = palpate_run("sweep", case, "--vary", "load[0].facto=1,2", "-o", tmp_path / "out")
    assert done.returncode == 2
    assert "did you mean 'load[0].factor'" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.dolfinx
@pytest.mark.long
def test_the_reference_is_solved_beside_where_asked_and_agrees(
    palpate_run: Command, tmp_path: Path, write_case: Callable[..., Path]
) -> None:
    folder = tmp_path / "out"
    done = palpate_run(
        "sweep", write_case(), "--vary", "load[0].factor=0.5", "--with", "reference",
        "--element", "both", "-o", folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "passed: fastsim and the reference agree" in done.stdout
    assert "over 4 pairs" in done.stdout
    found = {(r["simulator"], r["element"]) for r in rows_of(folder)}
    both = (Simulator.FASTSIM, Simulator.REFERENCE)
    assert found == {(who, str(element)) for who in both for element in Element}


def test_the_page_leads_with_up_to_where_linear_strain_may_stand_in(
    write_case: Callable[..., Path],
) -> None:
    case = load_case(write_case())
    axis = read_axis("load[0].factor=0.5,1,2", case)
    base = solve(case.problem)
    unit = base.displacement / np.linalg.norm(base.displacement)

    def both(off: float, value: float) -> list[Run]:
        states = {Strain.GREEN: unit, Strain.LINEAR: (1.0 + off) * unit}
        return [
            Run((value,), Simulator.FASTSIM, Element.LINEAR, strain,
                dataclasses.replace(base, displacement=moved, strain=strain))
            for strain, moved in states.items()
        ]  # fmt: skip

    # The last is within the limit once more, and beyond an excess: it is not allowed.
    runs = [*both(0.03, 0.5), *both(0.2, 1.0), *both(0.01, 2.0)]
    (limit,) = {s.limit for s in case.checks if (s.metric, s.against) == NEED} or {0.05}
    assert 0.03 < limit < 0.2
    allowed = f"{100.0 * limit:g} %"
    found = lead_of([axis], runs, case)
    assert found.startswith("Linear strain may stand in for Green's up to a factor of load 1 of")
    assert f"(3 % off; allowed: {allowed}" in found
    assert found.endswith("not at 1 (20 %).")
    assert "may not stand in" in lead_of([axis], both(0.2, 1.0), case)
    assert "at every value" in lead_of([axis], both(0.01, 1.0), case)
    assert lead_of([axis], both(0.01, 1.0)[:1], case) == ""
