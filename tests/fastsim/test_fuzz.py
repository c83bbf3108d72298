"""The mesher meets spoiled surfaces for some seconds: no crash, no hang, no wrong mesh."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

FUZZ = Path(__file__).parents[1] / "fuzz_surfaces.py"


def test_mutated_surfaces_are_meshed_or_refused(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(FUZZ), "--seconds", "8"],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert list(tmp_path.iterdir()) == []
    # It has both meshed and refused, or it has shown nothing.
    ends = dict(re.findall(r"'(\w+)': (\d+)", done.stderr))
    assert int(ends["meshed"]) > 5
    assert len(ends) > 4
