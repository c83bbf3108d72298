"""The gate goes red on every seeded fault, and says which check caught it; green without."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from palpate.validation.references.stored import references_folder

# The same-mesh displacement check is the sharpest: it must see every one of them.
ALWAYS = "displacement_l2|same_mesh"
FAULTS = {
    "softer": {ALWAYS, "volume|same_mesh"},
    "mirrored": {ALWAYS},
    "dropped-load": {ALWAYS, "volume|same_mesh"},
    "linear-instead-of-green": {ALWAYS, "volume|same_mesh", "surface_area|same_mesh"},
    "nan": {ALWAYS, "volume|truth", "smallest_det_f|candidate"},
}


def gate(*arguments: str, references: Path | None = None) -> subprocess.CompletedProcess[str]:
    import os

    environment = dict(os.environ)
    if references is not None:
        environment["PALPATE_REFERENCES"] = str(references)
    return subprocess.run(
        [sys.executable, "-m", "palpate.validation.cli", "gate", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        env=environment,
        check=False,
    )


def failed_checks(path: Path) -> dict[str, set[str]]:
    """Checks that failed, by case."""
    document = json.loads(path.read_text("utf-8"))
    return {
        case["name"]: {
            f"{c['metric']}|{c['against']}" for c in case["checks"] if c["verdict"] == "failed"
        }
        for case in document["cases"]
    }


def test_a_healthy_candidate_passes_both_cases(tmp_path: Path) -> None:
    out, junit, summary = (tmp_path / name for name in ("r.json", "j.xml", "s.md"))
    done = gate(
        "column", "beam", "--element", "smoothed",
        "--json", str(out), "--junit", str(junit), "--summary", str(summary),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads(out.read_text("utf-8"))
    assert [case["verdict"] for case in document["cases"]] == ["passed", "passed"]
    tests = ET.parse(junit).getroot().findall(".//testcase")
    assert len(tests) == sum(len(case["checks"]) for case in document["cases"]) >= 17
    assert "column" in summary.read_text("utf-8")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_seeded_fault_fails_both_cases(tmp_path: Path, fault: str) -> None:
    out, junit = tmp_path / "r.json", tmp_path / "j.xml"
    done = gate("kidney", "beam", "--fault", fault, "--json", str(out), "--junit", str(junit))
    assert done.returncode == 1, done.stdout + done.stderr
    failed = failed_checks(out)
    for case in ("kidney", "beam"):
        assert FAULTS[fault] <= failed[case], (case, failed[case])
    assert ET.parse(junit).getroot().findall(".//failure")


def test_a_softer_material_is_caught_by_the_same_mesh_check_not_by_the_truth(
    tmp_path: Path,
) -> None:
    # P1 is too stiff, so a softer material comes nearer to the truth.
    right, softer = tmp_path / "right.json", tmp_path / "softer.json"
    gate("beam", "--json", str(right))
    gate("beam", "--fault", "softer", "--json", str(softer))
    assert failed_checks(softer)["beam"] - failed_checks(right)["beam"] >= {ALWAYS}
    errors = [
        json.loads(path.read_text("utf-8"))["cases"][0]["metrics"][
            "error.truth.green.displacement_l2"
        ]
        for path in (right, softer)
    ]
    assert errors[1] < errors[0]


def test_a_missing_or_stale_or_damaged_reference_is_exit_two(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    done = gate("beam", references=empty)
    assert done.returncode == 2
    assert "no stored reference for 'beam'" in done.stderr

    stale = tmp_path / "stale"
    stale.mkdir()
    shutil.copy(references_folder() / "kidney.npz", stale / "beam.npz")
    done = gate("beam", references=stale)
    assert done.returncode == 2
    assert "stale" in done.stderr

    whole = (references_folder() / "beam.npz").read_bytes()
    (stale / "beam.npz").write_bytes(whole[: len(whole) // 2])
    done = gate("beam", references=stale)
    assert done.returncode == 2
    assert "damaged" in done.stderr
    assert "Traceback" not in done.stderr
