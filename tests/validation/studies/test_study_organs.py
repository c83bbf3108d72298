"""The study of organs: spoiled surfaces come through, and what is wrong with a mesh is seen."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_surface
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.states import Verdict
from palpate.validation.studies import organs, run_study
from palpate.validation.studies.organs import measures, trial
from palpate.validation.studies.organs.recipe import FEWEST, KINDS, Version, versions
from palpate.validation.studies.organs.spoiling import Spoiled
from palpate.validation.studies.organs.trial import Ending, Trial

BOX = shape_box((1.0, 1.0, 1.0), edge_length=0.5)
MESH = mesh_surface(BOX)


def quiet(_: str) -> None:
    pass


def test_the_recipe_has_each_defect_at_three_severities() -> None:
    assert 3 * len(KINDS) >= FEWEST
    assert len({kind.name for kind in KINDS}) == len(KINDS)
    for kind in KINDS:
        mild, middle, severe = kind.severities
        assert mild < middle < severe or mild > middle > severe
    again = [[v.spoiled.surface.points for v in versions(("crumpled",))] for _ in range(2)]
    assert np.array_equal(again[0], again[1])


def test_spoiled_surfaces_come_through_and_are_told() -> None:
    kinds = ("fins", "inner walls", "hanging points")
    mildest = list(versions(kinds))[::3]
    outcomes = organs.try_all(mildest, quiet, organs.attempt)
    assert [o.version.kind for o in outcomes] == list(kinds)
    assert [o.trial.ending for o in outcomes] == [Ending.MESHED] * 3
    assert all(o.is_near and o.is_sound for o in outcomes)
    assert all(o.trial.said != "nothing to mend" for o in outcomes)
    few, *others = organs.judge(outcomes)
    assert few.verdict is Verdict.FAILED  # three are no sixty
    assert {f.verdict for f in others} == {Verdict.PASSED}
    page = organs.present(outcomes)
    assert len(page.tables["surfaces"].rows) == 3
    assert "<svg" in page.figures["deviations"].svg


def test_a_process_of_its_own_gives_the_same_and_a_refusal_says_why() -> None:
    here = trial.attempt(BOX, distance=1.0, smallest_shell=0.0)
    there = trial.try_apart(BOX, distance=1.0, smallest_shell=0.0)
    assert (there.ending, there.said) == (Ending.MESHED, "nothing to mend")
    assert all(np.array_equal(there.arrays[k], here.arrays[k]) for k in here.arrays)
    assert there.mesh_volume == here.mesh_volume
    open_box = TriSurface(BOX.points, BOX.facets[:3])
    assert trial.attempt(open_box, distance=1.0, smallest_shell=0.0).ending is Ending.REFUSED


@pytest.mark.parametrize(
    ("code", "ending"), [(-11, Ending.CRASHED), (-24, Ending.OUT_OF_TIME), (0, Ending.CRASHED)]
)
def test_what_ends_the_process_is_told(
    monkeypatch: pytest.MonkeyPatch, code: int, ending: Ending
) -> None:
    def ended(*_: Any, **__: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess([], code, "", "last words\n")

    monkeypatch.setattr(trial, "run_supervised", ended)
    done = trial.try_apart(BOX, distance=1.0, smallest_shell=0.0)
    assert done.ending is ending
    assert ending is Ending.OUT_OF_TIME or done.said.endswith("last words")


def test_measures_of_a_mesh_that_is_as_meant() -> None:
    found = measures.measure(BOX, MESH.points, MESH.cells, BOX, allowed=1e-6)
    assert found.volume == pytest.approx(1.0, rel=1e-14)
    assert max(found.to_sound, found.from_sound) < 1e-15
    assert (found.wrong_facets, found.flat_cells, found.wrong_places) == (0, 0, 0)


def test_measures_see_what_is_wrong_with_a_mesh() -> None:
    def wrong(points: Any, cells: Any, sound: TriSurface = BOX) -> measures.Measured:
        return measures.measure(BOX, points, cells, sound, allowed=1e-6)

    missing = wrong(MESH.points, MESH.cells[1:])
    assert missing.wrong_facets > 0
    assert missing.volume < 1.0 - 1e-6
    twice = wrong(MESH.points, np.vstack([MESH.cells, MESH.cells[:1]]))
    assert twice.wrong_facets > 0
    turned = MESH.cells.copy()
    turned[0] = turned[0][[1, 0, 2, 3]]
    assert wrong(MESH.points, turned).flat_cells == 1
    larger = TriSurface(1.2 * BOX.points, BOX.facets)
    beside = wrong(MESH.points, MESH.cells, larger)
    assert beside.to_sound == pytest.approx(0.2, abs=1e-12)
    assert beside.from_sound == pytest.approx(0.2 * np.sqrt(3.0), abs=1e-12)
    assert beside.wrong_places > 0
    assert beside.volume_change == pytest.approx(1.2**-3 - 1.0)


def _outcome(**changed: Any) -> organs.Outcome:
    values: dict[str, Any] = {
        "version": Version("fins 1", "fins", 1.0, Spoiled(BOX, BOX)),
        "facets": 1000,
        "trial": Trial(Ending.MESHED, "done", 0.1, 0.1, 1.0),
        "cells": 10,
        "smallest_angle": 20.0,
        "allowed": 0.1,
        "measured": measures.Measured(0.01, 0.01, 1.0, 0.0, 0, 0, 0),
        "edge": 0.1,
    }
    return organs.Outcome(**{**values, **changed})


def test_each_claim_can_fail() -> None:
    good = [_outcome() for _ in range(60)]
    assert {f.verdict for f in organs.judge(good)} == {Verdict.PASSED}
    sound = measures.Measured(0.01, 0.01, 1.0, 0.0, 0, 0, 0)
    refused = {"trial": Trial(Ending.REFUSED, "why"), "measured": None}
    spoiled: list[tuple[int, list[organs.Outcome]]] = [
        (0, good[:59]),
        (0, [*good[:54], *[_outcome(**refused)] * 6]),
        (1, [*good, _outcome(trial=Trial(Ending.CRASHED, "gone"), measured=None)]),
        (1, [*good, _outcome(trial=Trial(Ending.REFUSED, ""), measured=None)]),
        (2, [*good, _outcome(measured=sound._replace(to_sound=0.11))]),
        (2, [*good, _outcome(measured=sound._replace(from_sound=0.11))]),
        (3, [*good, _outcome(measured=sound._replace(volume=1.0 + 1e-11))]),
        (3, [*good, _outcome(measured=sound._replace(wrong_facets=1))]),
        (3, [*good, _outcome(measured=sound._replace(flat_cells=1))]),
        (3, [*good, _outcome(measured=sound._replace(wrong_places=1))]),
        (4, [*good, _outcome(trial=Trial(Ending.MESHED, "done", 1.5, 1.0, 1.0))]),
    ]
    for number, outcomes in spoiled:
        verdicts = [f.verdict for f in organs.judge(outcomes)]
        assert verdicts[number] is Verdict.FAILED
        assert verdicts.count(Verdict.FAILED) == 1
    # What had to be ended is no refusal either.
    ended = _outcome(trial=Trial(Ending.OUT_OF_TIME, "ended"), measured=None)
    verdicts = [f.verdict for f in organs.judge([*good, ended])]
    assert [k for k, verdict in enumerate(verdicts) if verdict is Verdict.FAILED] == [1, 4]


def test_surfaces_of_a_folder_are_tried_as_well(tmp_path: Path) -> None:
    ball = shape_sphere(1.0, edge_length=0.5)
    write_surface(tmp_path / "open.off", TriSurface(ball.points, ball.facets[1:]))
    (found,) = organs.try_all(organs.surfaces_in(tmp_path), quiet, organs.attempt)
    assert found.trial.ending is Ending.MESHED
    assert found.is_near
    assert found.is_sound
    with pytest.raises(InputError, match="no surface there"):
        organs.surfaces_in(tmp_path / "none")
    with pytest.raises(InputError, match="study organs does"):
        run_study("beam", tmp_path, quiet, Console(), surfaces=tmp_path)
