"""The benchmark of the reference: the command that users type, with its memory and its answer."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.bricks import brick_box
from palpate.meshes.problem import Material, Problem, Strain
from palpate.reference.child import run_task
from palpate.reference.tasks import StaticTask
from palpate.validation.peers import bench_truth as truth
from palpate.validation.peers.bench import summarise, time_all
from palpate.validation.peers.registry import OURS
from palpate.validation.states import in_silence


@pytest.mark.dolfinx
def test_a_row_is_whole_and_its_answer_that_of_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(truth, "BLOCKS", {675: 2})
    alone = dataclasses.replace(truth.BENCHMARK, tools=truth.TOOLS[:1])
    (row,) = time_all(alone, (675,), in_silence)
    assert (row["tool"], row["size"], row["threads"]) == (OURS, 675, 1)
    assert row["iterations"] >= 3
    # An interpreter with dolfinx alone takes 70 MB; no block of 675 unknowns takes 2 GB.
    assert 70.0 < row["peak_memory_mb"] < 2000.0
    assert row["kb_per_unknown"] == pytest.approx(row["peak_memory_mb"] * 1024.0 / 675)

    mesh = brick_box((4, 2, 2), (2.0, 1.0, 1.0))
    facets = mesh.boundary_facets
    x = mesh.points[facets][:, :, 0]
    held, pulled = (facets[(x == end).all(axis=1)] for end in (0.0, 2.0))
    problem = Problem(
        mesh,
        Material(1000.0, 0.3),
        (Support(np.unique(held).astype(np.int32), held),),
        (Traction(pulled, (10.0, 5.0, -5.0)),),
    )
    found = run_task(StaticTask(strain=Strain.GREEN, degree=2), problem)
    largest = np.linalg.norm(found.displacement, axis=1).max()
    assert row["max_displacement"] == pytest.approx(largest, rel=1e-8)


def test_the_summary_says_how_far_the_answers_of_more_ranks_are_apart() -> None:
    common = {"size": 10, "version": "1", "precision": "float64"}
    rows = [
        common | {"tool": OURS, "seconds": 6.0, "max_displacement": 2.0},
        common | {"tool": "palpate under mpirun", "seconds": 3.0, "max_displacement": 3.0},
    ]
    assert summarise(truth.BENCHMARK, rows) == [
        "10, float64: 0.5 times palpate under mpirun 1, largest displacements 0.5 apart"
    ]
