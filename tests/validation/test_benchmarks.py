"""Benchmarks give whole rows, and the rivals compute the same thing."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.problem import Strain
from palpate.validation.benchmarks import static, steps
from palpate.validation.benchmarks.bodies import brick_box


def test_boxes_fill_their_volume_with_good_cells():
    mesh = brick_box((4, 3, 3), (2.0, 1.0, 1.0), ragged=0.15)
    assert mesh.num_cells == 6 * 4 * 3 * 3
    assert mesh.volume == pytest.approx(2.0, rel=1e-13)


def test_step_rows_are_whole_and_the_rival_has_the_same_force(monkeypatch):
    monkeypatch.setattr(steps, "SIZES", {648: (12, 3, 3)})
    monkeypatch.setattr(steps, "CELL_STEPS", 1e6)
    lines = []
    rows = steps.bench_steps(sizes=(648,), threads=(1, 2), progress=lines.append)
    assert [(r["tool"], r["precision"], r["threads"]) for r in rows] == [
        ("palpate", "float32", 1),
        ("palpate", "float32", 2),
        ("palpate", "float64", 1),
        ("palpate", "float64", 2),
        ("numpy", "float64", 1),
    ]
    assert len(lines) == 5
    assert all(row["size"] == 648 and np.isfinite(row["rate"]) for row in rows)
    assert rows[-1]["relative_force_error"] < 1e-12


@pytest.mark.dolfinx
def test_static_rows_agree_on_the_tip_to_six_digits(monkeypatch):
    monkeypatch.setattr(static, "DIVISIONS", {567: (20, 2, 2)})
    rows = static.bench_static(sizes=(567,))
    for strain in Strain:
        ours, theirs = (r["tip_displacement"] for r in rows if r["strain"] == strain.value)
        assert ours == pytest.approx(theirs, rel=1e-6)
