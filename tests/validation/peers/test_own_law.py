"""Simulators of others have no error of law under their own, and are found out under another."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.meshes.material_law import Law
from palpate.validation.case import load_case
from palpate.validation.peers.board import compute_board
from palpate.validation.peers.board_judge import LAW, MESH, SOLVER, Score
from palpate.validation.peers.board_runs import Cache
from palpate.validation.peers.registry import Peer, read_peers
from palpate.validation.states import in_silence

pytestmark = pytest.mark.dolfinx


def entry_of(name: str) -> Peer:
    entry = next(entry for entry in read_peers() if entry.name == name)
    if entry.command_line() is None:
        pytest.skip(entry.why_missing())
    return entry.model_copy(update={"compiles": False})


def score_of(folder: Path, entry: Peer, case: str = "shear") -> Score:
    board = compute_board(
        [entry], [load_case(case)], Cache(folder), time_limit=120.0, progress=in_silence
    )
    (score,) = board.scores.values()
    assert score.distance is not None, score.why
    return score


@pytest.mark.parametrize("name", ["mujoco-flex", "newton-semi-implicit", "newton-vbd"])
def test_under_its_own_law_a_simulator_has_no_error_of_law(tmp_path: Path, name: str) -> None:
    entry = entry_of(name)
    score = score_of(tmp_path, entry)
    assert score.law is entry.law
    assert score.follows == ""
    assert score.causes[LAW] == 0.0
    # Single precision, to rest within 1e-3 of the load.
    assert abs(score.causes[SOLVER]) < 2e-3
    if name == "mujoco-flex":  # a homogeneous state, which every mesh has
        assert abs(score.causes[MESH]) < 1e-6
    else:
        assert score.causes[MESH] < -0.03


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("newton-semi-implicit", Law.NEO_HOOKEAN_STABLE_LOG),
        ("newton-vbd", Law.NEO_HOOKEAN_STABLE),
    ],
)
def test_held_against_another_law_it_is_found_to_follow_its_own(
    tmp_path: Path, name: str, law: Law
) -> None:
    entry = entry_of(name)
    score = score_of(tmp_path, entry.model_copy(update={"law": Law.SAINT_VENANT_KIRCHHOFF}))
    assert score.follows == f"{law} law"
    # Of each part's difference none is the mesh's: Saint-Venant-Kirchhoff's is homogeneous here.
    assert abs(score.causes[LAW]) > 0.05
    assert abs(score.causes[SOLVER]) < 0.1 * abs(score.causes[LAW])
    assert abs(score.causes[MESH]) < 1e-6
