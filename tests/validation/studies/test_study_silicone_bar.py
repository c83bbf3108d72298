"""The measured bar: what is read of it, and what its study claims."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from palpate.validation.case.load import builtin_folder
from palpate.validation.metrics.measured_tracks import FrameError, Repeated
from palpate.validation.states import Verdict
from palpate.validation.studies import run_study, silicone_bar
from palpate.validation.studies.fit import Experiment, Validation, fit


@pytest.mark.parametrize("load", silicone_bar.RUNS)
def test_motions_are_as_long_as_in_the_laboratory(load: str) -> None:
    """A turned frame changes no length; the mean of two runs is a little shorter than they are."""
    found = silicone_bar.measure(load)
    lengths = []
    for file in silicone_bar.RUNS[load]:
        with (builtin_folder() / "silicone_beam" / file).open(encoding="utf-8") as text:
            rows = list(csv.DictReader(text))
        tip = [[float(row[f"tip_1_{axis}_mm"]) for axis in "xyz"] for row in rows]
        lengths.append(np.linalg.norm(np.mean(tip[-101:], axis=0) - tip[0]))
    found_length = 1e3 * np.linalg.norm(found.mean[0])
    assert found_length == pytest.approx(np.mean(lengths), rel=0.01)
    assert found.mean[0, 2] < 0.0  # it sinks
    # The runs differ by 1 to 4 % of the drop.
    assert 0.005 < found.uncertainty / np.abs(found.mean).max() < 0.04


def test_places_of_markers_that_are_a_centimetre_off_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    moved = {**silicone_bar.PLACES, "base_1": (16.0, -10.0, -1.0)}
    monkeypatch.setattr(silicone_bar, "PLACES", moved)
    with pytest.raises(FrameError, match="above 2 mm"):
        silicone_bar.measure("weight")


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [([0.1] * 9, Verdict.PASSED), ([0.1] * 8 + [0.95], Verdict.INCONCLUSIVE),
     ([0.1] * 8 + [-1.2], Verdict.FAILED)],
)  # fmt: skip
def test_the_worst_value_is_the_verdict(errors: list[float], verdict: Verdict) -> None:
    line = Experiment("x", ["a", "b"], np.array([1.0, 1.1]), np.ones(2), lambda v: v[[0, 0]] / 2e5)
    rows = [Validation(error, 0.03, 0.03, 0.03, 1.0) for error in errors]
    ways = [
        silicone_bar.Direction(
            "a", "b", fit([silicone_bar.MODULUS], [line]), rows, np.zeros((2, 1, 3))
        )
    ]
    measured = {"b": Repeated(np.zeros((3, 3)), 1.0, 9)}
    both = ways[0].fit
    found = silicone_bar.Found(measured, ways, both, np.zeros(9), np.ones(9), {})
    assert [f.verdict for f in silicone_bar.judge(found)] == [verdict]


def test_the_study_leaves_its_page_and_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(silicone_bar, "EDGES", (10.0, 7.0))  # coarse: a fast run
    code = run_study("silicone-bar", tmp_path, lambda _line: None, Console(quiet=True))
    assert code in (0, 1, 3)
    results = json.loads((tmp_path / "results.json").read_text("utf-8"))
    rows = results["tables"]["predictions"]
    assert len(rows) == 18
    for row in rows:
        # Within a tenth of the drop: the weight is not taken for the load, nor metres for
        # millimetres.
        drop = 26.65 if row["predicted"] == "load101" else 6.52
        assert abs(row["error [mm]"]) < 0.1 * drop
        parts = [row[f"{part} [mm]"] for part in ("numerical", "input", "data")]
        assert row["u_val [mm]"] == pytest.approx(np.linalg.norm(parts), rel=1e-9)
    third = [row["predicted [mm]"] for row in results["tables"]["third"] if "z" in row["value"]]
    assert all(-26.65 < drop < -6.5 for drop in third)  # between both loads
    moduli = {row["element"]: row["Young's modulus [kPa]"] for row in results["tables"]["elements"]}
    # Linear tetrahedra bend less than they should: the modulus would have to make up for it.
    assert 20.0 < moduli["linear"] < 0.7 * moduli["smoothed"] < 0.7 * 300.0
