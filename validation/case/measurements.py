"""What was measured of a case's body, read from its files.

Values are in SI units. A marker's value is its motion [m] from the first sample to the mean of the
window, in the body's frame. A frequency [Hz] is that of a decaying cosine fitted to a marker's
track. A force [N] is over the way that a tool has gone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Floats, Points
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Problem
from palpate.validation.case.geometry import inside_folder
from palpate.validation.case.load import Case
from palpate.validation.case.measurement_schema import MeasurementSpec
from palpate.validation.case.units import FORCE, LENGTH
from palpate.validation.case.variants import require_keys, with_values
from palpate.validation.metrics.markers import Pin, pin_on
from palpate.validation.metrics.measured_tracks import (
    ColumnError,
    EmptyWindowError,
    Frame,
    MeasurementError,
    Tracks,
    fit_frame,
    mean_of_runs,
    mean_place,
    read_rows,
    read_tracks,
)
from palpate.validation.metrics.time_series import fit_oscillation, fit_uncertainty

# From the bound of an error that may have any size up to it to its standard uncertainty.
_RECTANGULAR = math.sqrt(3.0)
_DEPTH, _FORCE = "depth", "force"


@dataclass(frozen=True, eq=False)
class Measured:
    """A measurement of a case, read.

    Attributes:
        spec: Its table in the case file.
        case: The case, without the numbers that this experiment has.
        labels: Of each value.
        values: Mean of the runs, SI units, shape (n,).
        uncertainty: Standard uncertainty of each, shape (n,).
        runs: Values of each run, shape (num_runs, n).
        depths: Way that the tool has gone at each value [m], shape (n,); empty of markers.
        unit: The case's unit of the values, and its name.
    """

    spec: MeasurementSpec
    case: Case
    labels: tuple[str, ...]
    values: Floats
    uncertainty: Floats
    runs: Floats
    depths: Floats
    unit: tuple[float, str]

    @property
    def limit(self) -> float | None:
        """Most that a value may be off, SI units; None where it is not judged."""
        return None if self.spec.limit is None else self.spec.limit * self.unit[0]

    def at(self, values: Mapping[str, float], *, like: Case | None = None) -> Case:
        """The experiment as a case with further numbers.

        Args:
            values: By key; those of the experiment itself count where they name the same.
            like: A case whose mesh is used again, where the same numbers shape it.
        """
        return with_values(self.case, {**values, **self.spec.set}, like=like)

    def with_runs(self, numbers: Sequence[int]) -> Measured:
        """The mean of some of its runs, with the uncertainty of one run over the root of theirs."""
        more = math.sqrt(len(self.runs) / len(numbers))
        return replace(
            self,
            values=self.runs[list(numbers)].mean(axis=0),
            uncertainty=self.uncertainty * more,
            runs=self.runs[list(numbers)],
        )


def pins_of(case: Case, names: Sequence[str]) -> dict[str, Pin]:
    """Pins of markers on a case's mesh, by name; each marker has a radius."""
    units, mesh = case.spec.units, case.problem.mesh
    markers = {marker.name: marker for marker in case.spec.marker}
    return {
        name: pin_on(
            mesh,
            np.array(units.lengths(markers[name].position)),
            radius=units.metres(markers[name].radius or 0.0),
        )
        for name in names
    }


def read_measurement(case: Case, spec: MeasurementSpec) -> Measured:
    """Read the files of a measurement.

    Args:
        case: The case.
        spec: One of its measurements.

    Returns:
        Mean, uncertainty and runs.

    Raises:
        MeasurementError: A file that cannot be used: see `measured_tracks`.
        InputError: A file that is missing or outside the case's folder, or a key of `set` that the
            case gives no number for.
    """
    what = f"measurement {spec.name!r}"
    require_keys(case, spec.set, what)
    paths = [inside_folder(case.folder, name) for name in spec.files]
    depths: Floats = np.zeros(0)
    doubt = 0.0
    unit = case.spec.units.of("length")
    if spec.kind == "rest":
        runs = [_motions(case, spec, path) for path in paths]
        labels = tuple(f"{name} {axis}" for name in spec.markers for axis in "xyz")
    elif spec.kind == "frequency":
        found = [_frequency(case, spec, path) for path in paths]
        runs = [np.array([value]) for value, _ in found]
        # What is left over of each fit is of the same modes in every run: it does not average out.
        doubt = max(off for _, off in found) / _RECTANGULAR
        labels, unit = (f"{spec.markers[0]} {spec.component}",), (1.0, "Hz")
    else:
        unit = case.spec.units.of("force")
        curves = [_curve(path) for path in paths]
        depths = curves[0][0]
        for path, (other, _) in zip(paths, curves, strict=True):
            if len(other) != len(depths) or not np.allclose(other, depths, rtol=1e-9, atol=0.0):
                raise ColumnError(
                    path.name, f"its depths are not those of {paths[0].name}; measure at the same"
                )
        runs = [force for _, force in curves]
        length, name = case.spec.units.of("length")
        labels = tuple(f"at {depth / length:.4g} {name}" for depth in depths)
        _require_reached(with_values(case, spec.set), spec, depths)
    if spec.uncertainty is not None:
        spread = spec.uncertainty * unit[0]
    else:
        spread = mean_of_runs(runs).uncertainty
    values = np.mean(runs, axis=0)
    return Measured(
        spec, case, labels, values, np.full(len(values), math.hypot(spread, doubt)),
        np.array(runs), depths, unit,
    )  # fmt: skip


def read_measurements(case: Case, names: Sequence[str] | None = None) -> dict[str, Measured]:
    """Read measurements of a case by name; all of them where no names are given.

    Raises:
        InputError: A name that none has, or see `read_measurement`.
    """
    known = {spec.name: spec for spec in case.spec.measurement}
    for name in names or ():
        if name not in known:
            there = ", ".join(known) or "none"
            raise InputError(f"{case.path.name} has no measurement {name!r}; there are {there}")
    return {n: read_measurement(case, known[n]) for n in (known if names is None else names)}


def _in_body(case: Case, spec: MeasurementSpec, path: Path) -> tuple[Tracks, Frame | None]:
    tracks = read_tracks(path)
    lost = [name for name in (*spec.markers, *spec.frame) if name not in tracks.markers]
    if lost:
        raise ColumnError(
            path.name,
            f"has no columns {lost[0]}_x_mm and so on; it has {', '.join(tracks.markers)}",
        )
    if not spec.frame:
        return tracks, None
    units = case.spec.units
    positions = {marker.name: marker.position for marker in case.spec.marker}
    frame = fit_frame(
        path.name,
        {name: np.array(units.lengths(positions[name])) for name in spec.frame},
        {name: tracks.markers[name][0] for name in spec.frame},
        limit=units.metres(spec.frame_limit or 0.0),
    )
    return tracks, frame


def _window(tracks: Tracks, spec: MeasurementSpec) -> tuple[float, float]:
    start = float(tracks.time[0]) if spec.start is None else spec.start
    return start, float(tracks.time[-1]) if spec.end is None else spec.end


def _motions(case: Case, spec: MeasurementSpec, path: Path) -> Floats:
    """Motion of each compared marker from the first sample to rest [m], flat."""
    tracks, frame = _in_body(case, spec, path)
    compared = Tracks(tracks.file, tracks.time, {n: tracks.markers[n] for n in spec.markers})
    limit = case.spec.units.metres(spec.rest_limit or 0.0)
    rest = mean_place(compared, *_window(tracks, spec), limit=limit)
    moved = []
    for name in spec.markers:
        ends: list[Points] = [tracks.markers[name][0], rest[name]]
        first, last = ends if frame is None else [frame.to_body(end) for end in ends]
        moved.append(last - first)
    return np.concatenate(moved)


def _frequency(case: Case, spec: MeasurementSpec, path: Path) -> tuple[float, float]:
    """Frequency of a marker's swing [Hz], and what the fit may be off."""
    tracks, frame = _in_body(case, spec, path)
    (marker,) = spec.markers
    compared = Tracks(tracks.file, tracks.time, {marker: tracks.markers[marker]})
    window = compared.between(*_window(tracks, spec))
    track = window.markers[marker]
    track = track if frame is None else frame.to_body(track)
    series = window.time, track[:, "xyz".index(spec.component or "z")]
    try:
        swing = fit_oscillation(*series)
    except InputError as error:
        raise MeasurementError(path.name, f"marker {marker}: {error}") from error
    off = fit_uncertainty(*series, swing).frequency * swing.frequency
    if not off < 0.5 * swing.frequency:
        raise MeasurementError(
            path.name,
            f"marker {marker}: {swing.frequency:.3g} Hz +- {off:.2g} Hz is no frequency; state a "
            "window from when it swings freely to before it is at rest",
        )
    return swing.frequency, off


def _curve(path: Path) -> tuple[Floats, Floats]:
    """Depths [m], increasing, and forces [N] of a CSV with the columns depth_mm and force_N."""
    rows = [row for row in read_rows(path) if any(cell.strip() for cell in row)]
    names = [name.strip() for name in rows[0]] if rows else []
    columns = []
    for name, sizes in ((_DEPTH, LENGTH), (_FORCE, FORCE)):
        matching = [k for k, n in enumerate(names) if n in {f"{name}_{unit}" for unit in sizes}]
        if len(matching) != 1:
            raise ColumnError(
                path.name,
                f"needs one column {name}_UNIT with a unit of {', '.join(sizes)}; it has "
                f"{', '.join(names) or 'none'}",
            )
        size = sizes[names[matching[0]].rpartition("_")[2]]
        try:
            columns.append(size * np.array([float(row[matching[0]]) for row in rows[1:]]))
        except (ValueError, IndexError):
            raise ColumnError(
                path.name,
                f"column {names[matching[0]]} has a cell that is no number; remove its row",
            ) from None
    depth, force = columns
    if len(depth) == 0:
        raise EmptyWindowError(path.name, "has no rows of numbers below its column names")
    if not (np.isfinite(depth).all() and np.isfinite(force).all()):
        raise ColumnError(path.name, "has a cell that is not finite; remove its row")
    if not (depth[0] > 0.0 and (np.diff(depth) > 0.0).all()):
        raise ColumnError(path.name, "its depths must be above 0 and increase; sort its rows")
    return depth, force


def travel(problem: Problem, tool: int) -> tuple[Floats, Floats]:
    """Times of a tool's path, and the way it has gone from its first pose at each [m]."""
    path = problem.tools[tool].path
    return path.times, np.linalg.norm(path.positions - path.positions[0], axis=1)


def _require_reached(case: Case, spec: MeasurementSpec, depths: Floats) -> None:
    _, way = travel(case.problem, (spec.tool or 1) - 1)
    if not (np.diff(way) > 0.0).all() or depths[-1] > way[-1] * (1.0 + 1e-9):
        raise InputError(
            f"measurement {spec.name!r}: tool {spec.tool} goes {way[-1]:.6g} m along its path, "
            f"which must be straight, and was measured at {depths[-1]:.6g} m; lengthen the path"
        )
