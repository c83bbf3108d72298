"""The gate goes red on every seeded fault, and says which check caught it; green without."""

from __future__ import annotations

import json
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., subprocess.CompletedProcess[str]]
# The same-mesh displacement check is the sharpest: it must see every one of them.
ALWAYS = "displacement_l2|same_mesh"
FAULTS = {
    "softer": {ALWAYS, "volume|same_mesh"},
    "mirrored": {ALWAYS},
    "dropped-load": {ALWAYS, "volume|same_mesh"},
    "linear-instead-of-green": {ALWAYS, "volume|same_mesh", "surface_area|same_mesh"},
    "nan": {ALWAYS, "volume|truth", "smallest_det_f|candidate"},
}


def failed_checks(path: Path) -> dict[str, set[str]]:
    """Checks that failed, by case."""
    document = json.loads(path.read_text("utf-8"))
    return {
        case["name"]: {
            f"{c['metric']}|{c['against']}" for c in case["checks"] if c["verdict"] == "failed"
        }
        for case in document["cases"]
    }


def test_a_healthy_candidate_passes_both_cases(palpate_run: Run, tmp_path: Path) -> None:
    out, junit, summary = (tmp_path / name for name in ("r.json", "j.xml", "s.md"))
    done = palpate_run("gate", "column", "beam", "--element", "smoothed",
        "--json", str(out), "--junit", str(junit), "--summary", str(summary),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads(out.read_text("utf-8"))
    assert [case["verdict"] for case in document["cases"]] == ["passed", "passed"]
    tests = ET.parse(junit).getroot().findall(".//testcase")
    assert len(tests) == sum(len(case["checks"]) for case in document["cases"]) >= 17
    assert "column" in summary.read_text("utf-8")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_seeded_fault_fails_both_cases(palpate_run: Run, tmp_path: Path, fault: str) -> None:
    out, junit = tmp_path / "r.json", tmp_path / "j.xml"
    done = palpate_run(
        "gate", "kidney", "beam", "--fault", fault, "--json", str(out), "--junit", str(junit)
    )
    assert done.returncode == 1, done.stdout + done.stderr
    failed = failed_checks(out)
    for case in ("kidney", "beam"):
        assert FAULTS[fault] <= failed[case], (case, failed[case])
    assert ET.parse(junit).getroot().findall(".//failure")


@pytest.mark.long
def test_a_softer_material_is_caught_by_the_same_mesh_check_not_by_the_truth(
    palpate_run: Run, tmp_path: Path
) -> None:
    # P1 is too stiff, so a softer material comes nearer to the truth.
    right, softer = tmp_path / "right.json", tmp_path / "softer.json"
    palpate_run("gate", "beam", "--json", str(right))
    palpate_run("gate", "beam", "--fault", "softer", "--json", str(softer))
    assert failed_checks(softer)["beam"] - failed_checks(right)["beam"] >= {ALWAYS}
    errors = [
        json.loads(path.read_text("utf-8"))["cases"][0]["metrics"][
            "error.truth.green.displacement_l2"
        ]
        for path in (right, softer)
    ]
    assert errors[1] < errors[0]
