"""Motions and poses of the live page as cases: a file, and what it names beside it."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.meshes.arrays import Floats
from palpate.meshes.atomic_write import atomic_path, write_text_atomically
from palpate.meshes.errors import InputError
from palpate.validation.case import Case
from palpate.validation.case.writing import case_text
from palpate.validation.live.grip import Grip
from palpate.validation.live.live_case import LiveCase

# States kept of a recorded motion, about so many a second.
_OUTPUTS = 30.0
_CHECKS: list[dict[str, Any]] = [
    {
        "metric": "trajectory_l2",
        "against": "same_mesh",
        "limit": 1e-6,
        "reason": "same mesh, path and time step: only rounding is left, which contact spreads",
    },
    {
        "metric": "tool_force",
        "against": "same_mesh",
        "limit": 1e-6,
        "reason": "the force in the hand, from output to output",
    },
    {
        "metric": "inverted_cells",
        "against": "candidate",
        "limit": 0.0,
        "reason": "no cell may be inverted",
    },
]


def ticks_of_output(tick: float, num_ticks: int) -> int:
    """Ticks between two states that are kept of a recording [-]."""
    return max(1, min(num_ticks, round(1.0 / (_OUTPUTS * tick))))


def write_recording(
    live: LiveCase, places: list[Floats], grips: Sequence[Grip], folder: Path, name: str
) -> Path:
    """Write a recorded motion as a case, which repeats it step by step.

    Args:
        live: What was touched.
        places: Of the tool in the case's unit at the end of each tick, from the start.
        grips: Holds of the surface since then.
        folder: Made where it is not there.
        name: Of the case.

    Returns:
        The case file.

    Raises:
        InputError: Nothing was recorded, or a file cannot be written.
    """
    num_ticks = len(places) - 1
    if num_ticks < 1:
        raise InputError("nothing was recorded: begin, move the tool, then end the recording")
    each = ticks_of_output(live.clock.tick, num_ticks)
    # The tool rests until the last state that is kept.
    places = [*places, *[places[-1]] * (-num_ticks % each)]
    data = live.with_path(places)
    data["time"]["num_outputs"] = (len(places) - 1) // each
    clock = live.clock
    springs = [grip.recorded(clock.time_step, clock.steps) for grip in grips if grip.places]
    if springs:
        data["spring"] = [*data.get("spring", []), *springs]
    data["title"] = f"{live.case.title}: touched"
    data["check"] = _CHECKS
    return write_case(live.case, data, folder, name)


def write_case(case: Case, data: dict[str, Any], folder: Path, name: str) -> Path:
    """Write tables as a case file, with the files that the case names beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in case.files[1:]:
        copy = folder / file.relative_to(case.folder)
        if file.is_file() and not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(copy) as temporary:
                shutil.copyfile(file, temporary)
    path = folder / f"{name}.toml"
    write_text_atomically(path, case_text(data))
    return path


def free_name(folder: Path, stem: str) -> str:
    """A name that no case of the folder has: stem-1, stem-2, ..."""
    number = 1
    while (folder / f"{stem}-{number}.toml").exists():
        number += 1
    return f"{stem}-{number}"
