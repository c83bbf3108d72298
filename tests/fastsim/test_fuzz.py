"""The mesher meets corrupted surfaces for some seconds: no crash, no hang, no wrong mesh."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.parametrize(
    "seed",
    [
        1,  # no pairs to copy (a null pointer, under sanitizers)
        146,  # bins of inner points far from the origin (an overflow, under sanitizers)
        14, 322,  # cells flat to rounding where parts of the surface nearly lie in a plane
    ],
)  # fmt: skip
def test_what_the_fuzz_has_found_stays_repaired(seed: int) -> None:
    assert _try_one(seed) == "meshed"


@pytest.mark.parametrize(
    "seed",
    [
        83,  # cells flat to rounding, as above
        30358,  # flattened to 1e-10 of its size
    ],
)
def test_what_hangs_on_the_last_bit_is_right_or_refused(seed: int) -> None:
    # The last bits of these surfaces differ from processor to processor. With others of them the
    # boundary is not recovered in 1 of 60 and 11 of 60 tries; no mesh may be wrong.
    assert _try_one(seed) in {"meshed", "not recovered"}


def _try_one(seed: int) -> str:
    spec = importlib.util.spec_from_file_location("fuzz_surfaces", FUZZ)
    assert spec is not None
    assert spec.loader is not None
    fuzz = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fuzz)
    with np.errstate(all="ignore"):
        return str(fuzz.try_one(seed, repairs=False))
