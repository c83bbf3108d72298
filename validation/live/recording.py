"""Grips, motions and poses of the live page as cases: a file, and what it names beside it."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from palpate.fastsim.springs import PatchSprings
from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import file_hash
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.temporaries import atomic_path, write_text_atomically
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.units import FORCE, LENGTH
from palpate.validation.case.writing import case_text
from palpate.validation.live.live_case import LiveCase
from palpate.validation.live.panes import ExplicitPane, Pane
from palpate.validation.live.pointer import Pointer

# Fraction of the stiffest spring that the time step allows: two grips of a recording may overlap.
_PART_OF_ROOM = 0.4
# The number of grips that one recording may have, for that reason.
MOST_GRIPS = 2


@dataclass
class Grip:
    """A grip of the surface by a spring.

    Attributes:
        table: The spring's table in a case file, without path.
        spring: The same spring in SI units, its anchor at the patch.
        pointer: Moves the anchor, in the case's unit, relative to the body at rest.
        first: Position of the anchor when the grip began, in the case's unit.
        begin: Step at which the grip began.
        end: Step at which it ended; None while it lasts.
        positions: Position of the anchor at the end of each tick.
    """

    table: dict[str, Any]
    spring: Spring
    pointer: Pointer
    first: Floats
    begin: int
    end: int | None = None
    positions: list[Floats] = field(default_factory=list)

    def recorded(self, clock_step: float, steps: int) -> dict[str, Any]:
        """The spring's table with path and factors over time.

        It is switched on and off within the preceding step: forces are computed at whole steps.

        Args:
            clock_step: Length of a step [s].
            steps: Number of steps in a tick.
        """
        path = [self.first, *self.positions]
        table = dict(self.table)
        table["path"] = [
            {"time": (self.begin + number * steps) * clock_step, "displacement": position.tolist()}
            for number, position in enumerate(path)
        ]
        factors: dict[int, float] = {}
        if self.begin > 0:
            factors |= {self.begin - 1: 0.0, self.begin: 1.0}
        if self.end is not None:
            factors |= {self.end - 1: 1.0, self.end: 0.0}
        if factors:
            table["amplitude"] = {
                "times": [step * clock_step for step in sorted(factors)],
                "factors": [factors[step] for step in sorted(factors)],
            }
        return table

    def static_table(self) -> dict[str, Any]:
        """The spring's table with the anchor at its present position, for statics."""
        return {**self.table, "displacement": self.pointer.position.tolist()}


def make_grip(
    live: LiveCase,
    pane: ExplicitPane,
    point: int,
    radius: float,
    *,
    largest_way: float,
    digits: int,
) -> Grip:
    """Grip the surface about one of its points.

    The patch is as stiff as a rigid disc of that radius on a half space, 2 E r, or less where that
    would be unstable at the time step.

    Args:
        live: The case that is touched.
        pane: The pane whose patch gives the anchor's start; there the spring has no force.
        point: A point of the mesh, by its number.
        radius: [m], > 0.
        largest_way: Largest distance that the anchor moves in a tick, in the case's unit.
        digits: Decimal places of positions in the case's unit.

    Raises:
        InputError: There is no patch at this point.
    """
    units, mesh, body = live.case.spec.units, live.problem.mesh, pane.body
    position = np.round(mesh.points[point] / live.unit, digits)
    size = float(f"{radius / live.unit:.6g}")

    x, y, z = live.metres(position).tolist()

    def spring_of(stiffness: float, anchor: Floats) -> Spring:
        path = AnchorPath(np.zeros(1), live.metres(anchor)[None])
        return Spring.on(mesh, (x, y, z), units.metres(size), stiffness, path)

    patch = PatchSprings(mesh.points, (spring_of(1.0, np.zeros(3)),))
    if pane.trouble:
        raise InputError("the body stands still; reset it first")
    room = (4.0 / body.time_step**2 - 4.0 / body.critical_time_step**2) * body.mass
    rows = patch.row_sums()
    most = _PART_OF_ROOM * float((room[rows > 0.0] / rows[rows > 0.0]).min())
    wanted = 2.0 * live.problem.material.youngs_modulus * radius
    per_unit = FORCE[units.force] / LENGTH[units.length]
    stiffness = float(f"{min(wanted, most) / per_unit:.3g}")
    first = np.round(patch.mean_displacements(body.displacement)[0] / live.unit, digits)
    spring = spring_of(units.newtons_per_metre(stiffness), first)
    table = {"center": position.tolist(), "radius": size, "stiffness": stiffness}
    pointer = Pointer(first, np.zeros(3), largest_way, digits)
    return Grip(table, spring, pointer, first, body.steps)


# The approximate number of states that are stored for each second of a recorded motion.
_OUTPUTS = 30.0
# The tolerance of the truth: a fifth of the smallest limit below.
_BAR = 0.01
# A displacement below this fraction of the body's size is not worth a verdict.
_NOTHING = 1e-6


def _check(metric: str, against: str, limit: float, reason: str) -> dict[str, Any]:
    return {"metric": metric, "against": against, "limit": limit, "reason": reason}


_WHOLE_CELLS = "no cell may be inverted"
_MOTION_CHECKS = (
    _check("trajectory_l2", "same_mesh", 1e-6,
           "same mesh, path and time step: only rounding is left, which contact spreads"),
    _check("tool_force", "same_mesh", 1e-6, "the force on the tool, from output to output"),
    _check("inverted_cells", "candidate", 0.0, _WHOLE_CELLS),
)  # fmt: skip
_POSE_CHECKS = (
    _check("displacement_l2", "truth", 0.05,
           "a twentieth of the displacement: of 16 mm, an instrument is placed to one"),
    _check("smallest_det_f", "candidate", 0.0, _WHOLE_CELLS),
)  # fmt: skip
_FORCE_CHECK = _check(
    "tool_force", "truth", 0.07,
    "a hand tells forces that differ by 7 to 10 % (L. A. Jones, Perception 18, 1989)",
)  # fmt: skip


def ticks_of_output(tick: float, num_ticks: int) -> int:
    """Number of ticks between two stored states of a recording [-]."""
    return max(1, min(num_ticks, round(1.0 / (_OUTPUTS * tick))))


def write_recording(
    live: LiveCase, positions: list[Floats], grips: Sequence[Grip], folder: Path, name: str
) -> Path:
    """Write a recorded motion as a case, which repeats it step by step.

    Args:
        live: The case that was touched.
        positions: Positions of the tool at the end of each tick from the start, in the case's unit.
        grips: Grips of the surface since the start.
        folder: Where the case goes; it is made where it does not exist.
        name: The name of the case.

    Returns:
        The case file.

    Raises:
        InputError: Nothing was recorded, or a file cannot be written.
    """
    num_ticks = len(positions) - 1
    if num_ticks < 1:
        raise InputError("nothing was recorded: begin, move the tool, then end the recording")
    each = ticks_of_output(live.clock.tick, num_ticks)
    # The tool stays in position until the last stored state.
    positions = [*positions, *[positions[-1]] * (-num_ticks % each)]
    data = live.with_path(positions)
    data["time"]["num_outputs"] = (len(positions) - 1) // each
    clock = live.clock
    springs = [grip.recorded(clock.time_step, clock.steps) for grip in grips if grip.positions]
    if springs:
        data["spring"] = [*data.get("spring", []), *springs]
    data["title"] = f"{live.case.title}: touched"
    data["check"] = list(_MOTION_CHECKS)
    return write_case(live.case, data, folder, name)


def write_pose(
    live: LiveCase,
    position: Floats,
    panes: Sequence[Pane],
    forces: Sequence[Floats],
    grip: dict[str, Any] | None,
    folder: Path,
    name: str,
    to_go: Floats | None = None,
) -> tuple[Path, Path]:
    """Write the present pose as a static case, with the solutions of the panes beside it.

    Args:
        live: The case that is touched.
        position: Position of the tool, in the case's unit, shape (3,).
        panes: The panes in their present state.
        forces: Force on the tool [N], shape (3,) for each pane.
        grip: Table of the spring that grips the surface.
        folder: Where the case goes; it is made where it does not exist.
        name: The name of the case.
        to_go: What is left of each pane's motion over its largest displacement [-], shape
            (num_panes,); None where all are at rest.

    Returns:
        The case file, and the .npz with displacements, forces, names, elements and `to_go`.

    Raises:
        InputError: Nothing acts on the body.
    """
    mesh = live.problem.mesh
    size = float(np.ptp(mesh.points, axis=0).max())
    moved = [np.array(pane.displacement) for pane in panes]
    if max(float(np.abs(u).max()) for u in moved) < _NOTHING * size:
        raise InputError("nothing acts on the body: press it first, and hold still")
    data = live.with_path([position])
    data.pop("time")
    data["strain"] = "green"
    data["title"] = f"{live.case.title}: a pose of the live page"
    given = parse_toml(live.case.text) if live.has_loads else {}
    springs = [*given.get("spring", []), *([] if grip is None else [grip])]
    for key, tables in (("load", given.get("load")), ("spring", springs)):
        data.pop(key, None)
        if tables:
            data[key] = tables
    data["check"] = list(_POSE_CHECKS)
    data["truth"] = {"bar": _BAR}
    if any(np.any(force) for force in forces):
        # The tool comes straight from outside: without friction its path does not matter.
        out = max(0.0, float((live.start - position) @ live.outwards))
        pose = data["tool"][0]["pose"][0]
        data["tool"][0]["pose"] = [
            {**pose, "time": 0.0, "position": (position + out * live.outwards).tolist()},
            {**pose, "time": 1.0, "position": position.tolist()},
        ]
        data["check"].insert(1, _FORCE_CHECK)
    else:
        data.pop("tool")
    path = write_case(live.case, data, folder, name)
    solutions = folder / f"{name}.npz"
    with atomic_path(solutions) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            displacement=np.array(moved),
            force=np.array(forces),
            names=np.array([pane.name for pane in panes]),
            strain=np.array([pane.strain.value for pane in panes]),
            element=np.array([pane.element.value for pane in panes]),
            to_go=np.zeros(len(panes)) if to_go is None else to_go,
        )
    return path, solutions


def write_case(case: Case, data: dict[str, Any], folder: Path, name: str) -> Path:
    """Write tables as a case file, and beside it the files that the case names.

    Raises:
        InputError: Another file of such a name is there: the case would be of another body.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for file in case.files[1:]:
        copy = folder / file.relative_to(case.folder)
        if not file.is_file():
            continue
        if not os.path.lexists(copy):
            copy.parent.mkdir(parents=True, exist_ok=True)
            with atomic_path(copy) as temporary:
                shutil.copyfile(file, temporary)
        elif not (copy.is_file() and file_hash(copy) == file_hash(file)):
            raise InputError(f"{copy}: differs from the case's own {file.name}; use another -o")
    path = folder / f"{name}.toml"
    write_text_atomically(path, case_text(data))
    return path


def free_name(folder: Path, stem: str) -> str:
    """A name that no case or solution of the folder has: stem-1, stem-2, ..."""
    names = (f"{stem}-{number}" for number in itertools.count(1))
    ends = (".toml", ".npz")
    return next(n for n in names if not any(os.path.lexists(folder / f"{n}{e}") for e in ends))
