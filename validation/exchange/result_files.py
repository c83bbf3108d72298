"""Results as files: .npz, .vtu or .csv, read with nothing taken on trust, and written.

What cannot be read is a ResultFileError (exit 2). NaN is read: it is the candidate's failure.
"""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.files import MESH_SUFFIXES, read_result_arrays, write_mesh
from palpate.meshes.own_files import own_path
from palpate.meshes.problem import Problem
from palpate.meshes.untrusted import (
    UntrustedTextError,
    array_names,
    parse_json,
    read_npz,
    read_text,
)
from palpate.validation.conversions import LENGTH
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.states import State

RESULT_SUFFIXES = (".npz", ".vtu", ".csv")
# A mesh of a million points with its five million tetrahedra and its displacement.
_ALWAYS_ALLOWED = 256 * 1024**2
# A mesh refined twice has 64 times as many points; so many times as many states.
_TIMES_THE_CASES = 64
# Arrays that are read of an .npz file; others are left alone.
_ARRAYS = (
    "displacement", "positions", "times", "points", "cells", "original_id", "cauchy_stress",
)  # fmt: skip
_TEXTS = ("length_unit", "case_key", "about")
_MOST_CHARACTERS = 1_000_000
# Relative to the largest component: single precision, and sums.
_SYMMETRIC_TO = 1e-4
_AXES = ("x", "y", "z")


class ResultFileError(FileFormatError):
    """A result that cannot be used: unreadable, wrong count, units unknown; `.path` names it."""


@dataclass(frozen=True, eq=False)
class ResultFile:
    """A result as it stands, in metres.

    Attributes:
        path: The file that was read.
        values: Displacement, or positions, [m]; (num_times, num_points, 3).
        are_positions: Whether `values` are positions.
        times: [s], (num_times,); None for a single state.
        points: The result's own points [m], (num_points, 3), if it gives any.
        cells: Its own tetrahedra, (n, 4), if it gives any.
        original_id: Number in the case of each point, (num_points,), if given.
        cauchy_stress: Of the last state [Pa], (n, 3, 3), by `cells`, or by the case's where it
            gives none; symmetric to rounding.
        case_key: Key of the case that it solves, if given.
        about: Tool, version, law: what the simulator says of itself.
    """

    path: Path
    values: NDArray[np.float64]
    are_positions: bool
    times: Points | None = None
    points: Points | None = None
    cells: NDArray[np.int64] | None = None
    original_id: NDArray[np.int64] | None = None
    cauchy_stress: NDArray[np.float64] | None = None
    case_key: str = ""
    about: dict[str, Any] = field(default_factory=dict)


def room_for_result(problem: Problem) -> int:
    """What a result of a case may take when unpacked, in bytes: many times what its own would."""
    states = 1 if problem.time is None else problem.time.num_outputs + 1
    own = problem.mesh.points.nbytes * states
    return max(_ALWAYS_ALLOWED, _TIMES_THE_CASES * own)


def read_result(path: str | Path, *, most_bytes: int = _ALWAYS_ALLOWED) -> ResultFile:
    """Read a result by its ending.

    Args:
        path: .npz, .vtu or .csv.
        most_bytes: What its arrays may take when unpacked; see `room_for_result`.

    Raises:
        ResultFileError: Missing, damaged, of another kind, too large, without displacement or
            positions (or with both), of the wrong shape, or with a unit that is not known.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in RESULT_SUFFIXES:
        why = f"unknown kind; use {', '.join(RESULT_SUFFIXES)}"
        if suffix == ".npy":
            why = (
                f"an array without a name; np.savez('{file.stem}.npz', displacement=...) gives one"
            )
        raise ResultFileError(path, why)
    try:
        match suffix:
            case ".npz":
                names = (*_ARRAYS, *_TEXTS)
                named: dict[str, Any] = {**read_npz(file, most_bytes=most_bytes, names=names)}
            case ".vtu":
                named = _read_vtu(file, most_bytes)
            case _:
                named = _read_csv(file, read_text(file, most_bytes=most_bytes))
    except ResultFileError:
        raise
    except FileFormatError as error:
        raise ResultFileError(file, str(error).removeprefix(f"{file}: ")) from error
    return _from_arrays(file, named)


def _from_arrays(file: Path, named: dict[str, Any]) -> ResultFile:
    given = [key for key in ("displacement", "positions") if key in named]
    if len(given) != 1:
        names = array_names(file) if file.suffix.lower() == ".npz" else sorted(named)
        has = ", ".join(repr(name) for name in names) or "nothing"
        raise ResultFileError(
            file, f"needs exactly one of displacement, positions (it holds: {has})"
        )

    def require(is_so: bool | np.bool_, reason: str) -> None:
        if not is_so:
            raise ResultFileError(file, reason)

    unit = _text(file, named, "length_unit", "m")
    require(unit in LENGTH, f"length_unit {unit!r} is not known; use {', '.join(LENGTH)}")
    scale = LENGTH.get(unit, 1.0)
    values = _numbers(file, given[0], named[given[0]])
    if values.ndim == 2:
        values = values[None]
    shape = f"{given[0]} has shape {values.shape}; needs (num_points, 3) or with times first"
    require(values.ndim == 3 and values.shape[2] == 3 and 0 not in values.shape, shape)
    num_times, num_points = values.shape[:2]
    times = points = cells = original = None
    if "times" in named:
        times = np.atleast_1d(_numbers(file, "times", named["times"]))
        grow = times.shape == (num_times,) and (np.diff(times) > 0.0).all()
        require(
            grow and np.isfinite(times).all(),
            f"times must increase and be finite, one for each of {num_times}",
        )
    require("times" in named or num_times == 1, f"holds {num_times} states without `times`")
    if "points" in named:
        points = scale * _numbers(file, "points", named["points"])
        shape = f"points have shape {points.shape}, but {given[0]} {values.shape[1:]}"
        require(points.shape == values.shape[1:], shape)
    if "cells" in named:
        cells = _whole(file, "cells", named["cells"])
        is_right = cells.ndim == 2 and cells.shape[1] == 4
        require(is_right, f"cells have shape {cells.shape}; needs (num_cells, 4)")
        is_there = not cells.size or (cells.min() >= 0 and cells.max() < num_points)
        require(is_there, "cells name points that do not exist")
    if "original_id" in named:
        original = _whole(file, "original_id", named["original_id"]).ravel()
        count = f"{len(original)} original_id but {num_points} rows of {given[0]}"
        require(len(original) == num_points, count)
    return ResultFile(
        file,
        scale * values,
        given[0] == "positions",
        times,
        points,
        cells,
        original,
        _stress(file, named, cells),
        _text(file, named, "case_key", ""),
        _about(file, named),
    )


def _stress(
    file: Path, named: dict[str, Any], cells: NDArray[np.int64] | None
) -> NDArray[np.float64] | None:
    """Nine components row by row, flat or not; NaN is read, and the candidate's failure."""
    if "cauchy_stress" not in named:
        return None
    stress = _numbers(file, "cauchy_stress", named["cauchy_stress"])
    if stress.shape[1:] not in ((9,), (3, 3)):
        raise ResultFileError(
            file,
            f"cauchy_stress has shape {stress.shape}; needs (num_cells, 9), row by row, or "
            "(num_cells, 3, 3)",
        )
    stress = stress.reshape(-1, 3, 3)
    if cells is not None and len(stress) != len(cells):
        raise ResultFileError(file, f"{len(stress)} rows of cauchy_stress but {len(cells)} cells")
    with np.errstate(over="ignore", invalid="ignore"):
        uneven = np.abs(stress - stress.transpose(0, 2, 1)).max(initial=0.0)
    if uneven > _SYMMETRIC_TO * np.abs(stress).max(initial=0.0):
        raise ResultFileError(file, "cauchy_stress is not symmetric; is it another stress?")
    return stress


def _text(file: Path, named: dict[str, Any], name: str, default: str) -> str:
    """One piece of text, bytes included: what a numpy array of one string holds."""
    if name not in named:
        return default
    array = np.asarray(named[name])
    if array.dtype.kind not in "US" or array.size != 1:
        raise ResultFileError(file, f"`{name}` must be one text, not {array.dtype} {array.shape}")
    if array.dtype.itemsize > _MOST_CHARACTERS:
        raise ResultFileError(file, f"`{name}` is longer than {_MOST_CHARACTERS} bytes")
    item = array.ravel()[0]
    return item.decode("utf-8", errors="replace") if isinstance(item, bytes) else str(item)


def _about(file: Path, named: dict[str, Any]) -> dict[str, Any]:
    try:
        about = parse_json(_text(file, named, "about", "{}"), allow_nan=True)
    except UntrustedTextError as error:
        raise ResultFileError(file, f"`about` cannot be used: {error}") from error
    if not isinstance(about, dict):
        raise ResultFileError(file, "`about` must be a JSON object")
    return about


def _numbers(file: Path, name: str, array: Any) -> NDArray[np.float64]:
    values = np.asarray(array)
    if values.dtype.kind not in "fiu":
        raise ResultFileError(file, f"{name} holds {values.dtype}, not numbers")
    return np.asarray(values, dtype=np.float64)


def _whole(file: Path, name: str, array: Any) -> NDArray[np.int64]:
    values = _numbers(file, name, array)
    # Beyond 2^53 a float64 is no whole number that could be trusted.
    if not ((np.abs(values) < 2.0**53).all() and (values == np.floor(values)).all()):
        raise ResultFileError(file, f"{name} holds what is no whole number")
    return values.astype(np.int64)


def _read_vtu(file: Path, most_bytes: int) -> dict[str, Any]:
    points, cells, fields, of_cells = read_result_arrays(file, most_bytes=most_bytes)
    named: dict[str, Any] = {**fields, "points": points}
    if "cauchy_stress" in of_cells:
        named["cauchy_stress"] = of_cells["cauchy_stress"]
    return {**named, "cells": cells} if len(cells) else named


def _read_csv(file: Path, text: str) -> dict[str, Any]:
    """Columns x, y, z (points), ux, uy, uz or px, py, pz, original_id; one row for each point."""
    try:
        rows = [row for row in csv.reader(io.StringIO(text, newline="")) if row]
    except csv.Error as error:
        raise ResultFileError(file, f"cannot be read as csv ({error})") from error
    if len(rows) < 2:
        raise ResultFileError(file, "needs a line of column names and one line for each point")
    names = [name.strip() for name in rows[0]]
    columns: dict[str, NDArray[np.float64]] = {}
    try:
        table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except ValueError as error:
        raise ResultFileError(file, f"a cell is no number, or a row is short ({error})") from error
    if table.shape[1] != len(names) or len(set(names)) != len(names):
        raise ResultFileError(file, f"{len(names)} different column names needed for the columns")
    columns = dict(zip(names, table.T, strict=True))
    named: dict[str, Any] = {}
    for key, prefix in (("points", ""), ("displacement", "u"), ("positions", "p")):
        wanted = [f"{prefix}{axis}" for axis in _AXES]
        if all(name in columns for name in wanted):
            named[key] = np.column_stack([columns[name] for name in wanted])
    if "original_id" in columns:
        named["original_id"] = columns["original_id"]
    return named


WRITTEN_SUFFIXES = (*MESH_SUFFIXES, ".npz")


def require_written_kind(path: Path) -> None:
    """Raise InputError for a file that no solution can be written to."""
    if path.suffix.lower() not in WRITTEN_SUFFIXES:
        raise InputError(f"{path}: unknown kind; use {', '.join(WRITTEN_SUFFIXES)}")


def write_solution(path: Path, problem: Problem, state: State) -> str:
    """Write a state: displacement and stresses on its mesh, or, as .npz, the whole motion.

    Stresses are fields of cells [Pa], where the state has them: `second_piola_kirchhoff_stress` and
    `cauchy_stress`, nine components row by row, and `von_mises_stress`.

    Args:
        path: .vtu, .vtk or .npz; a file of that name is replaced.
        problem: The problem that was solved.
        state: The state, at the mesh's points.

    Returns:
        One line that says what is in the file.

    Raises:
        InputError: Another kind of file.
    """
    require_written_kind(path)
    said = f"{path}: displacement [m] of {problem.mesh.num_points} points, {state.strain} strain"
    motion = state.trajectory
    if path.suffix.lower() != ".npz":
        stresses: dict[str, NDArray[Any]] = {}
        if state.stresses is not None:
            stresses = {
                "second_piola_kirchhoff_stress": state.stresses.second_piola_kirchhoff.reshape(
                    -1, 9
                ),
                "cauchy_stress": state.stresses.cauchy.reshape(-1, 9),
                "von_mises_stress": state.stresses.von_mises,
            }
        displacement = {"displacement": state.displacement}
        write_mesh(path, problem.mesh, point_data=displacement, cell_data=stresses)
        if stresses:
            said += f", stresses [Pa] of {problem.mesh.num_cells} cells"
        if motion is None:
            return said
        return f"{said}, at {motion.times[-1]:g} s; a file .npz holds the whole motion"
    about: dict[str, Any] = {
        "tool": f"palpate, {state.simulator}",
        "element": state.element.value,
    }
    if state.tool_forces is not None:
        about["tool_forces"] = state.tool_forces.tolist()
    arrays: dict[str, Any] = {"displacement": state.displacement}
    if motion is not None:
        arrays = {"displacement": motion.displacements, "times": motion.times}
        said += f", {len(motion.times)} states to {motion.times[-1]:g} s"
    arrays["case_key"] = np.array(case_key(problem, state.strain))
    arrays["about"] = np.array(json.dumps(about, allow_nan=False))
    with own_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    return said
