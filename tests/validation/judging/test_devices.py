"""fastsim on a device is one more candidate: same-mesh checks, in float32 and in float64."""

from __future__ import annotations

from pathlib import Path

import pytest
from judged import case_of, judge, on_same_mesh
from typer.testing import CliRunner

from palpate.meshes.errors import InputError
from palpate.validation.candidates.candidate import candidates_for, fastsim_candidate
from palpate.validation.candidates.faults import Fault, with_fault
from palpate.validation.cli import app
from palpate.validation.judging.results import CaseResult
from palpate.validation.solving import solve
from palpate.validation.states import Precision, Verdict

WARP = "warp:cpu"


@pytest.fixture(autouse=True)
def _needs_warp() -> None:
    pytest.importorskip("warp", reason="the extra `gpu` is not installed")


def values_of(result: CaseResult) -> dict[str, tuple[float, Verdict]]:
    found = {check.metric: (check.value, check.verdict) for check in on_same_mesh(result)}
    assert found
    return found


@pytest.mark.long
def test_in_double_precision_it_is_judged_as_the_core_is() -> None:
    case = case_of("block-motion")
    core, device = (
        values_of(judge(case, candidate=fastsim_candidate(device=name))) for name in ("cpu", WARP)
    )
    assert core.keys() == device.keys()
    for name, (value, verdict) in core.items():
        assert device[name][1] is verdict is Verdict.PASSED
        # An amplitude is read off a fit, which is 1e-9 off for either.
        exact = 1e-9 if name.startswith("oscillation") else 1e-10
        assert device[name][0] == pytest.approx(value, abs=exact), name


@pytest.mark.long
@pytest.mark.nightly
def test_in_single_precision_it_passes_where_that_is_granted() -> None:
    case = case_of("block-motion")
    single = fastsim_candidate(device=WARP, precision=Precision.SINGLE)
    granted = judge(case, candidate=single, precision=Precision.SINGLE)
    found = values_of(granted)
    assert {verdict for _, verdict in found.values()} == {Verdict.PASSED}
    assert max(value for value, _ in found.values()) > 1e-10  # it is single precision
    softer = judge(case, candidate=with_fault(single, Fault.SOFTER), precision=Precision.SINGLE)
    assert Verdict.FAILED in {verdict for _, verdict in values_of(softer).values()}


def test_a_static_case_is_relaxed_on_a_device() -> None:
    result = judge(case_of("block"), candidate=fastsim_candidate(device=WARP))
    assert {verdict for _, verdict in values_of(result).values()} == {Verdict.PASSED}


def test_what_has_no_explicit_steps_takes_no_device() -> None:
    problem = case_of("block").problem
    with pytest.raises(InputError, match="relaxation"):
        solve(problem, device=WARP)
    with pytest.raises(InputError, match="reference"):
        solve(problem, device=WARP, with_="reference")
    with pytest.raises(InputError, match="its own"):
        candidates_for("mysim {case} {result}", 10.0, device=WARP)
    relaxed = solve(problem, method="relaxation", device=WARP)
    assert relaxed.label == "fastsim on warp:cpu"


@pytest.mark.parametrize(
    "words",
    [
        ["gate", "block", "--device", "cuda:9"],
        ["gate", "block", "--device", WARP, "--expected"],
        ["sweep", "block", "--vary", "load[0].factor=1,2", "--device", WARP, "--jobs", "2"],
        ["solve", "block", "--device", "cuda:9", "--method", "relaxation"],
    ],
)
def test_the_command_line_refuses_with_a_reason(words: list[str], tmp_path: Path) -> None:
    out = ["-o", str(tmp_path / "out.vtu")] if words[0] in ("sweep", "solve") else []
    result = CliRunner().invoke(app, [*words, *out])
    assert isinstance(result.exception, InputError)
    assert "device" in str(result.exception)


@pytest.mark.parametrize(("fault", "code"), [("none", 0), ("softer", 1)])
def test_a_device_is_compared_with_the_core_without_a_reference(fault: str, code: int) -> None:
    words = ["gate", "block-motion", "--device", WARP, "--versus", "fastsim", "--fault", fault]
    assert CliRunner().invoke(app, [*words, "--limit", "trajectory_l2=1e-9"]).exit_code == code


def test_a_sweep_runs_on_a_device(tmp_path: Path) -> None:
    out = tmp_path / "sweep"
    words = ["sweep", "block-motion", "--vary", "material.youngs_modulus=24,25", "-o", str(out)]
    result = CliRunner().invoke(app, [*words, "--device", WARP])
    assert result.exit_code == 0, result.output
    assert (out / "report.html").is_file()
