"""Tracks of markers on a real body: read from a file, in the body's frame, at rest.

A file is CSV with a unit in each column: `time_s` and, for each marker, `NAME_x_mm`, `NAME_y_mm`,
`NAME_z_mm` (or `_cm`, `_m`). The laboratory's frame becomes the body's by the rigid motion that
fits stated places best (W. Kabsch, Acta Crystallographica A 32, 1976, p. 922). What a frame's error
does to a distance moved is a rotation only.
"""

from __future__ import annotations

import csv
import importlib.util
import itertools
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import scratch_folder

_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
# A minute of a hundred markers takes a second to read [s].
_PATIENCE = 60.0
_AXES = ("x", "y", "z")
# A unit that was misread is wrong by ten at least; bodies that deform change distances by less.
_WRONG_UNIT = 3.0
# Labels are searched through for exchanged ones up to this many markers (720 orders).
_MOST_ORDERED = 6


class MeasurementError(InputError):
    """A measurement cannot be used as it is; the text names file, column or time, and the remedy.

    Attributes:
        file: Name of the file.
    """

    def __init__(self, file: str, reason: str) -> None:
        self.file = file
        super().__init__(f"{file}: {reason}")


class ColumnError(MeasurementError):
    """A column is missing, named twice, without a unit, or not of numbers."""


class GapError(MeasurementError):
    """A marker is lost for a while, within the time that is asked for."""


class ExchangedLabelsError(MeasurementError):
    """Two markers have each other's name, from some time on or throughout."""


class LengthUnitError(MeasurementError):
    """Distances between markers are many times those that are stated."""


class FrameError(MeasurementError):
    """No rigid motion takes the stated places to the measured ones within the stated limit."""


class RestlessError(MeasurementError):
    """The body still moves in the time in which it is said to be at rest."""


class EmptyWindowError(MeasurementError):
    """No frame lies in the time that is asked for."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Where markers were, over time.

    Attributes:
        file: Name of the file they were read from.
        time: [s], shape (num_frames,), increasing.
        markers: Position of each marker [m], shape (num_frames, 3); NaN where it was lost.
    """

    file: str
    time: Floats
    markers: Mapping[str, Points]

    def between(self, start: float, end: float) -> Tracks:
        """The frames of a time window.

        Args:
            start: First time [s].
            end: Last time [s], included.

        Returns:
            Tracks without gaps.

        Raises:
            EmptyWindowError: There is no frame.
            GapError: A marker is lost within the window.
        """
        # Times are printed to some digits: half a millionth of the span is no other frame.
        slack = 5e-7 * float(self.time[-1] - self.time[0])
        inside = (self.time >= start - slack) & (self.time <= end + slack)
        if not inside.any():
            raise EmptyWindowError(
                self.file,
                f"no frame from {start:g} s to {end:g} s; the file has {self.time[0]:g} s to "
                f"{self.time[-1]:g} s: state a window within it",
            )
        time = self.time[inside]
        markers = {name: track[inside] for name, track in self.markers.items()}
        for name, track in markers.items():
            lost = np.flatnonzero(~np.isfinite(track).all(axis=1))
            if len(lost):
                raise GapError(
                    self.file,
                    f"marker {name} is lost in {len(lost)} of {len(time)} frames, first at "
                    f"{time[lost[0]]:g} s; state a window without the gap, or leave the marker out",
                )
        return Tracks(self.file, time, markers)


class Frame(NamedTuple):
    """Rigid motion from the body's frame to the laboratory's: x_lab = rotation x + translation.

    `rms` is what is left between stated and measured places, root of the mean square [m].
    """

    rotation: Floats
    translation: Floats
    rms: float

    def to_body(self, positions: Points) -> Points:
        """Positions of the laboratory [m], shape (n, 3), in the body's frame."""
        return np.asarray((positions - self.translation) @ self.rotation)


def read_tracks(path: str | Path) -> Tracks:
    """Read tracks of markers from C3D, or from CSV with units in its column names.

    Args:
        path: .c3d (needs ezc3d), or a file with `time_s` and `NAME_x_mm`, `NAME_y_mm`, `NAME_z_mm`
            for each marker; an empty cell or `nan` is a marker that was lost.

    Returns:
        All frames, in metres and seconds.

    Raises:
        MeasurementError: The file is missing, or no text.
        ColumnError: Columns are missing, named twice, without a known unit or not of numbers, or
            time does not increase.
        ExchangedLabelsError: Two markers swap their places from one frame to the next.
    """
    path = Path(path)
    if path.suffix.lower() == ".c3d":
        return _read_c3d(path)
    rows = read_rows(path)
    if len(rows) < 2:
        raise ColumnError(path.name, "has no frame; needs a line of names and lines of numbers")
    names = [name.strip() for name in rows[0]]
    for name in names:
        if names.count(name) > 1:
            raise ColumnError(path.name, f"column {name} is there twice; rename or remove one")
    values = _numbers(path.name, names, rows[1:])
    if "time_s" not in names:
        raise ColumnError(path.name, "has no column time_s; name the time's column so, in seconds")
    time = values[:, names.index("time_s")]
    bad = np.flatnonzero(~(np.diff(time) > 0.0))
    if len(bad) or not np.isfinite(time).all():
        where = f" after {time[bad[0]]:g} s" if len(bad) else ""
        raise ColumnError(path.name, f"column time_s does not increase{where}; sort its frames")
    tracks = Tracks(path.name, time, _markers(path.name, names, values))
    _require_own_labels(tracks)
    return tracks


def read_rows(path: Path) -> list[list[str]]:
    """The rows of a CSV file that are not empty, as text.

    Raises:
        MeasurementError: The file is missing, or no text.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise MeasurementError(path.name, f"cannot be read as CSV ({error})") from None


def _read_c3d(path: Path) -> Tracks:
    """The markers of a motion capture, read in a process of its own."""
    if importlib.util.find_spec("ezc3d") is None:
        raise MeasurementError(path.name, 'needs ezc3d; pip install "palpate[motion-capture]"')
    with scratch_folder("tracks") as folder:
        result = folder / "tracks.npz"
        program = Path(__file__).with_name("c3d_program.py")
        try:
            ended = run_supervised(
                # -P: modules beside the program have names of the standard library's.
                [sys.executable, "-P", program, path.absolute(), result],
                time_limit=_PATIENCE,
            )
        except subprocess.TimeoutExpired:
            raise MeasurementError(
                path.name, f"was not read within {_PATIENCE:g} s; export it as CSV"
            ) from None
        if ended.returncode or not result.is_file():
            why = (ended.stderr.strip().splitlines() or ["its reader crashed"])[-1]
            raise MeasurementError(path.name, f"cannot be read as C3D ({why}); export it again")
        with np.load(result, allow_pickle=False) as found:
            labels, unit = [str(name).strip() for name in found["labels"]], str(found["unit"])
            time, positions = found["time"], found["positions"]
    if unit not in _METRES:
        raise ColumnError(
            path.name, f"its unit is {unit!r}; export it in one of {', '.join(_METRES)}"
        )
    twice = [name for name in labels if labels.count(name) > 1]
    if twice or not labels:
        why = f"marker {twice[0]} is there twice; rename one" if twice else "has no markers"
        raise ColumnError(path.name, why)
    if len(time) < 2 or not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        raise ColumnError(path.name, "has no frames at an increasing time; export it again")
    tracks = Tracks(
        path.name, time, {n: _METRES[unit] * p for n, p in zip(labels, positions, strict=True)}
    )
    _require_own_labels(tracks)
    return tracks


def _numbers(file: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> Floats:
    values = np.full((len(rows), len(names)), math.nan)
    for k, row in enumerate(rows):
        if len(row) != len(names):
            raise ColumnError(
                file, f"line {k + 2} has {len(row)} cells for {len(names)} columns; complete it"
            )
        for c, cell in enumerate(row):
            try:
                values[k, c] = float(cell) if cell.strip() else math.nan
            except ValueError:
                raise ColumnError(
                    file, f"column {names[c]}, line {k + 2}: {cell[:40]!r} is no number; leave the "
                    "cell empty where a marker was lost"
                ) from None  # fmt: skip
    return values


def _markers(file: str, names: Sequence[str], values: Floats) -> dict[str, Points]:
    columns: dict[str, dict[str, Floats]] = {}
    for c, name in enumerate(names):
        if name == "time_s":
            continue
        marker, _, rest = name.rpartition("_")
        marker, _, axis = marker.rpartition("_")
        if not marker or axis not in _AXES or rest not in _METRES:
            raise ColumnError(
                file, f"column {name} is not of a marker; name it NAME_x_mm with an axis of x, y, "
                f"z and a unit of {', '.join(_METRES)}"
            )  # fmt: skip
        if axis in columns.setdefault(marker, {}):
            raise ColumnError(file, f"marker {marker} has two columns for {axis}; remove one")
        columns[marker][axis] = _METRES[rest] * values[:, c]
    for marker, found in columns.items():
        missing = [axis for axis in _AXES if axis not in found]
        if missing:
            raise ColumnError(file, f"marker {marker} has no column for {', '.join(missing)}")
    return {m: np.column_stack([found[a] for a in _AXES]) for m, found in columns.items()}


def _require_own_labels(tracks: Tracks) -> None:
    """Refuse markers that jump to each other's places within one frame."""
    for (a, first), (b, second) in itertools.combinations(tracks.markers.items(), 2):
        before_a, before_b, after_a, after_b = first[:-1], second[:-1], first[1:], second[1:]
        kept = _length(after_a - before_a) + _length(after_b - before_b)
        crossed = _length(after_a - before_b) + _length(after_b - before_a)
        # Exchanged, each moves by their distance; a frame's own motion is far less.
        (frames,) = np.nonzero(kept > 3.0 * crossed)
        if len(frames):
            raise ExchangedLabelsError(
                tracks.file,
                f"markers {a} and {b} change places after {tracks.time[frames[0]]:g} s; exchange "
                "their columns from there on",
            )


def _length(vectors: Points) -> Floats:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def fit_frame(file: str, stated: Mapping[str, Points], measured: Mapping[str, Points], *,
              limit: float) -> Frame:  # fmt: skip
    """Rigid motion that takes stated places of markers to measured ones, by least squares.

    Args:
        file: Name of the file, for errors.
        stated: Place of three or more markers in the body's frame [m], shape (3,), not on a line.
        measured: Their place in the laboratory's frame [m], shape (3,).
        limit: Largest rms distance that is left [m], > 0.

    Returns:
        The motion, without reflection.

    Raises:
        FrameError: Fewer than three markers, markers on a line, a marker that was not measured, or
            more than `limit` is left.
        LengthUnitError: Measured distances are more than three times the stated ones, or less than
            a third.
        ExchangedLabelsError: Other names for the same markers fit within the limit.
    """
    lost = [name for name in stated if name not in measured]
    if lost or len(stated) < 3:
        raise FrameError(
            file,
            f"a frame needs three markers that were measured; {len(stated)} are stated"
            + (f", and {', '.join(lost)} not measured" if lost else ""),
        )
    names = list(stated)
    body = np.array([stated[name] for name in names], float)
    lab = np.array([measured[name] for name in names], float)
    sizes = [float(np.linalg.norm(x - x.mean(axis=0))) for x in (body, lab)]
    if np.linalg.matrix_rank(body - body.mean(axis=0), tol=1e-6 * sizes[0]) < 2:
        raise FrameError(file, "the markers of the frame lie on a line; state one beside it")
    ratio = sizes[1] / sizes[0]
    if not 1.0 / _WRONG_UNIT < ratio < _WRONG_UNIT:
        raise LengthUnitError(
            file,
            f"distances of markers are {ratio:.3g} times the stated ones; correct the unit in the "
            "column names, or that of the stated places",
        )
    frame = rigid_motion(body, lab)
    if frame.rms <= limit:
        return frame
    if len(names) <= _MOST_ORDERED:
        orders = itertools.permutations(range(len(names)))
        order = min(orders, key=lambda o: rigid_motion(body, lab[list(o)]).rms)
        other = rigid_motion(body, lab[list(order)])
        if other.rms <= limit:
            wrong = [(names[i], names[k]) for i, k in enumerate(order) if i != k]
            raise ExchangedLabelsError(
                file,
                f"rms {1e3 * frame.rms:.3g} mm as named, {1e3 * other.rms:.3g} mm where "
                + ", ".join(f"{a} is the column {b}" for a, b in wrong)
                + "; rename these columns",
            )
    left = _length(frame.to_body(lab) - body)
    worst = int(np.argmax(left))
    raise FrameError(
        file,
        f"rms {1e3 * frame.rms:.3g} mm of the rigid fit is above {1e3 * limit:.3g} mm, most at "
        f"{names[worst]} ({1e3 * left[worst]:.3g} mm); correct its stated place, or state a limit",
    )


def rigid_motion(body: Points, lab: Points) -> Frame:
    """Rigid motion that takes points to others best, by least squares.

    Args:
        body: Points [m], shape (n, 3), n >= 3.
        lab: Where they are [m], shape (n, 3).

    Returns:
        The motion, without reflection.
    """
    centers = body.mean(axis=0), lab.mean(axis=0)
    left, _, right = np.linalg.svd((lab - centers[1]).T @ (body - centers[0]))
    sign = np.sign(np.linalg.det(left @ right))
    rotation = left @ np.diag([1.0, 1.0, sign]) @ right
    translation = centers[1] - rotation @ centers[0]
    rest = lab - body @ rotation.T - translation
    return Frame(rotation, translation, float(np.sqrt(np.mean(np.sum(rest**2, axis=1)))))


def mean_place(tracks: Tracks, start: float, end: float, *, limit: float) -> dict[str, Points]:
    """Where each marker is at rest: the mean over a window in which none moves.

    Args:
        tracks: Tracks of a run.
        start: First time of the window [s].
        end: Last time of the window [s].
        limit: Largest motion [m], > 0: of a marker's standard deviation, and between the means of
            the window's halves.

    Returns:
        Mean position of each marker [m], shape (3,).

    Raises:
        EmptyWindowError: There is no frame.
        GapError: A marker is lost within the window.
        RestlessError: A marker moves by more than the limit.
    """
    window = tracks.between(start, end)
    middle = len(window.time) // 2
    for name, track in window.markers.items():
        spread = float(np.sqrt(np.sum(track.var(axis=0))))
        halves = (track[: max(middle, 1)].mean(axis=0), track[middle:].mean(axis=0))
        moved = max(spread, float(np.linalg.norm(halves[1] - halves[0])))
        if moved > limit:
            raise RestlessError(
                tracks.file,
                f"marker {name} moves by {1e3 * moved:.3g} mm from {start:g} s to {end:g} s, more "
                f"than {1e3 * limit:.3g} mm; state a later window, or measure for longer",
            )
    return {name: track.mean(axis=0) for name, track in window.markers.items()}


class Repeated(NamedTuple):
    """Mean of repeated runs, and its standard uncertainty, pooled over all values.

    `mean` has the shape of one run; `degrees` are the degrees of freedom of `uncertainty`.
    """

    mean: Floats
    uncertainty: float
    degrees: int


def mean_of_runs(runs: Sequence[Floats]) -> Repeated:
    """Mean of repeated runs of one experiment and what their scatter says of it.

    The scatter of two runs at one value says next to nothing: the variance is the mean over all
    values of the experiment, each of which counts as of the same instrument.

    Args:
        runs: Values of each run, two at least, of one shape.

    Returns:
        The mean and its standard uncertainty, in the values' unit.

    Raises:
        InputError: Fewer than two runs.
    """
    if len(runs) < 2:
        raise InputError("uncertainty from runs needs two at least; state the uncertainty instead")
    values = np.array(runs, float)
    variance = float(values.var(axis=0, ddof=1).mean())
    degrees = (len(runs) - 1) * int(values[0].size)
    return Repeated(values.mean(axis=0), math.sqrt(variance / len(runs)), degrees)
