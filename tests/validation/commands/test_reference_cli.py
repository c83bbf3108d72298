"""Stored references: built, accepted with a reason, checked; stale or damaged ones are refused."""

from __future__ import annotations

import dataclasses
import re
import shutil

import numpy as np
import pytest

from palpate.meshes.problem import Material, Strain
from palpate.validation.case import QUICK, builtin_cases, builtin_folder, load_case
from palpate.validation.references import statics
from palpate.validation.references.reference_set import TRUTH
from palpate.validation.references.stored import (
    MissingReferenceError,
    StaleReferenceError,
    accept_pending,
    accepted_path,
    describe_changes,
    load_stored,
    pending_path,
    problem_key,
    read_reference,
    references_folder,
    store,
    write_reference,
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """References of some small cases, to be perturbed."""
    for name in {*QUICK, "beam", "kidney", "shear"}:
        shutil.copy(references_folder() / f"{name}.npz", tmp_path)
    monkeypatch.setenv("PALPATE_REFERENCES", str(tmp_path))
    return tmp_path


def build_anew(name="block"):
    """What `build` would leave behind, of a truth with 1e-9 of noise and a wider bar."""
    case = load_case(name)
    found, _ = read_reference(accepted_path(name))
    states = {
        position: dataclasses.replace(
            s,
            displacement=(1.0 + 1e-9) * s.displacement,
            max_displacement=(1.0 + 1e-9) * s.max_displacement,
        )
        if s.label == TRUTH
        else s
        for position, s in found.states.items()
    }
    bars = {**found.bars, ("volume", Strain.GREEN): 1.01 * found.bars["volume", Strain.GREEN]}
    # Of its parts nothing stays: they do not add up to the wider bar.
    of_file = found.provenance.items()
    reported = {k: v for k, v in of_file if k not in ("bar_parts", "accepted")}
    changed = dataclasses.replace(found, states=states, bars=bars, provenance=reported)
    store(name, case.problem, changed, reported, path=pending_path(name))
    return case


def test_every_built_in_case_has_a_reference_that_belongs_to_it():
    for name in builtin_cases():
        assert load_stored(name, load_case(name).problem).states


def test_references_of_ones_own_case_are_kept_beside_it(
    tmp_path, command_line, monkeypatch, capsys
):
    for suffix in (".toml", ".vtu"):
        shutil.copy(builtin_folder() / f"block{suffix}", tmp_path)
    path = str((tmp_path / "block.toml").rename(tmp_path / "mine.toml"))
    solved = read_reference(accepted_path("block"))[0]
    monkeypatch.setattr(statics, "solve_for_storing", lambda *_given, **_options: solved)
    monkeypatch.chdir(tmp_path)
    assert command_line("gate", path) == 2
    assert "no reference is stored" in capsys.readouterr().err
    assert command_line("reference", "build", path) == 0
    assert (tmp_path / "references" / "mine.pending.npz").is_file()
    assert command_line("gate", path) == 2
    assert command_line("reference", "accept", path, "--reason", "first") == 0
    capsys.readouterr()
    assert command_line("reference", "check", path) == 0
    assert re.search(r"made [0-9-]+ in \d+ s, \d+ s of the processor", capsys.readouterr().out)
    assert command_line("gate", path) == 0
    assert sorted(p.name for p in (tmp_path / "references").iterdir()) == ["mine.npz"]
    assert not (references_folder() / "mine.npz").exists()
    capsys.readouterr()
    # What to do is said with the name that the command line takes.
    text = (tmp_path / "mine.toml").read_text("utf-8")
    changed = text.replace("youngs_modulus = 10.0", "youngs_modulus = 11.0")
    (tmp_path / "mine.toml").write_text(changed, encoding="utf-8")
    assert command_line("gate", path) == 2
    assert "reference build mine.toml" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_nothing_is_used_before_it_is_accepted(command_line, capsys):
    case = build_anew()
    position = ("volume", Strain.GREEN)
    before = load_stored("block", case.problem).bars[position]
    assert command_line("reference", "accept", "block", "--reason", " ") == 2
    assert load_stored("block", case.problem).bars[position] == before
    reason = ("--reason", "wider, and that is right", "--by", "a tester")
    assert command_line("reference", "accept", "block", *reason) == 0
    after = load_stored("block", case.problem)
    assert after.bars[position] == 1.01 * before
    accepted = after.provenance["accepted"]
    assert (accepted["by"], accepted["reason"]) == ("a tester", "wider, and that is right")
    line = next(x for x in accepted["changes"] if "refined, green strain, max_displacement" in x)
    assert "relative change 1e-09" in line
    wider = "error bar of volume, green strain: 0.00724"
    assert any(x.startswith(wider) for x in accepted["changes"])
    assert not pending_path("block").exists()
    capsys.readouterr()
    assert command_line("reference", "check", "block") == 0
    assert "by a tester: wider, and that is right" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_accepting_needs_something_built_for_the_case_as_it_is(command_line):
    assert command_line("reference", "accept", "block", "--reason", "why not") == 2
    case = build_anew()
    other = dataclasses.replace(case.problem, material=Material(1.0, 0.3))
    with pytest.raises(StaleReferenceError, match="has changed since"):
        accept_pending("block", other, {})
    pending_path("block").write_bytes(b"not a reference")
    with pytest.raises(MissingReferenceError, match="damaged"):
        accept_pending("block", case.problem, {})


@pytest.mark.parametrize("missing", ["command", "versions", "adaptive"])
def test_nothing_is_accepted_without_its_provenance_and_record(
    folder, command_line, capsys, missing
):
    build_anew()
    references, key = read_reference(pending_path("block"))
    perturbed = {k: v for k, v in references.provenance.items() if k != missing}
    write_reference(pending_path("block"), "block", key, references, perturbed)
    before = (folder / "block.npz").read_bytes()
    assert command_line("reference", "accept", "block", "--reason", "trust me") == 2
    words = " ".join(capsys.readouterr().err.split())
    assert (missing in words) or "with no record of meshes" in words
    assert (folder / "block.npz").read_bytes() == before


@pytest.mark.parametrize("accepted", [None, {"by": "", "date": "2026-01-01", "reason": "fine"}])
def test_what_nobody_has_accepted_is_refused_by_the_check(folder, command_line, capsys, accepted):
    references, key = read_reference(accepted_path("block"))
    provenance = {**references.provenance, "accepted": accepted}
    write_reference(folder / "block.npz", "block", key, references, provenance)
    assert command_line("reference", "check", "block") == 2
    assert "who accepted it" in " ".join(capsys.readouterr().err.split())


def forge(folder, name):
    """Quadratic tetrahedra 3 % too soft, on every mesh alike, with a hash that is right."""
    references, key = read_reference(accepted_path(name))
    states = {
        position: dataclasses.replace(
            state,
            displacement=1.03 * state.displacement,
            max_displacement=1.03 * state.max_displacement,
        )
        if state.degree == 2
        else state
        for position, state in references.states.items()
    }
    forged = dataclasses.replace(references, states=states)
    write_reference(folder / f"{name}.npz", name, key, forged, dict(references.provenance))


@pytest.mark.dolfinx
def test_a_forged_file_with_its_right_hash_is_found_by_solving_anew(folder, command_line, capsys):
    forge(folder, "shear")
    assert command_line("reference", "check", "shear") == 0
    assert command_line("reference", "check", "shear", "--solve", "--time-limit", 20) == 1
    reported = capsys.readouterr().out
    assert "shear: failed: reference P2, linear strain" in reported
    assert "shear: passed: reference P1, linear strain" in reported
    assert "shear: passed: reference smoothed, green strain" in reported


@pytest.mark.dolfinx
@pytest.mark.usefixtures("folder")
def test_cases_are_chosen_by_chance_and_again_by_the_seed(command_line, capsys, monkeypatch):
    from palpate.validation.references import solved_again

    solved = []

    def note(problem, *_given):
        solved.append(problem)
        return [solved_again.Comparison("all", 0.0)]

    monkeypatch.setattr(solved_again, "compare_anew", note)
    names = ("block", "beam", "shear", "kidney")
    choices = set()
    for seed in range(6):
        assert (
            command_line("reference", "check", *names, "--solve", "--cases", 2, "--seed", seed) == 0
        )
        lines = capsys.readouterr().out.splitlines()
        (line,) = (one for one in lines if one.startswith("solved anew (--seed "))
        assert f"--seed {seed})" in line
        choices.add(line.split(": ")[1])
    assert len(solved) == 12
    assert len(choices) > 2
    assert command_line("reference", "check", "block", "--seed", 1) == 2
    monkeypatch.setattr(
        solved_again, "compare_anew", lambda *_: [solved_again.Comparison("truth", None)]
    )
    assert command_line("reference", "check", "block", "--solve") == 3


def halve_displacements(path):
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    np.savez(path, **{n: 0.5 * a if n.startswith("displ") else a for n, a in arrays.items()})


@pytest.mark.parametrize("perturb", ["missing", "damaged", "cut", "stale", "altered"])
def test_a_gate_refuses_what_does_not_belong_to_its_case(folder, command_line, capsys, perturb):
    path = folder / "block.npz"
    whole = path.read_bytes()
    if perturb == "missing":
        path.unlink()
    elif perturb == "damaged":
        path.write_bytes(whole[:100] + bytes(100) + whole[200:])
    elif perturb == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif perturb == "stale":
        shutil.copy(folder / "beam.npz", path)
    else:
        halve_displacements(path)
    assert command_line("reference", "check", "beam", "block", "kidney") == 2
    reported = capsys.readouterr()
    assert "kidney:" in reported.out
    assert "palpate reference build block" in reported.err
    assert command_line("gate", "block") == 2


def test_changes_of_the_case_and_of_bars_are_reported(folder):
    case = build_anew()
    lines = describe_changes(accepted_path("beam"), pending_path("block"))
    assert lines[0] == "mesh, material, supports or loads have changed"
    assert any("another mesh" in line for line in lines)
    assert any(line.startswith("error bar of volume") for line in lines)
    (folder / "none.npz").write_bytes(b"")
    assert describe_changes(folder / "none.npz", pending_path("block"))[0].startswith("nothing")
    assert problem_key(case.problem) == read_reference(pending_path("block"))[1]


@pytest.mark.usefixtures("folder")
def test_the_quick_gate_passes_on_stored_references_alone(command_line, monkeypatch, capsys):
    from palpate.reference import availability

    monkeypatch.setattr(availability, "is_available", lambda: False)
    assert set(QUICK) <= set(builtin_cases())
    assert command_line("gate", "--quick") == 0
    reported = capsys.readouterr().out
    for name in QUICK:
        assert f"{name}: passed" in reported


def test_a_gate_wants_its_cases_said_once(command_line):
    assert command_line("gate") == 2
    assert command_line("gate", "beam", "--quick") == 2
    assert command_line("gate", "--quick", "--all") == 2
