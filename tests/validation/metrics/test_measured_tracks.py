"""Tracks of markers: what is read, the frame they are brought into, and what is refused."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import InputError
from palpate.meshes.transforms import rotation
from palpate.validation.metrics.measured_tracks import (
    ColumnError,
    EmptyWindowError,
    ExchangedLabelsError,
    FrameError,
    GapError,
    LengthUnitError,
    MeasurementError,
    RestlessError,
    Tracks,
    fit_frame,
    mean_of_runs,
    mean_place,
    read_tracks,
)

# Places in the body's frame [m], of no symmetry.
STATED = {
    "a": np.array([0.0, 0.0, 0.0]),
    "b": np.array([0.1, 0.0, 0.01]),
    "c": np.array([0.0, 0.03, 0.0]),
    "d": np.array([0.02, 0.01, 0.05]),
}
TURN = rotation((1.0, 2.0, 3.0), 70.0)
SHIFT = np.array([0.3, -0.2, 0.1])
NOISE = 2e-5  # [m], of a motion-capture system


def tracks(frames: int = 101, *, noise: float = NOISE) -> dict[str, np.ndarray]:
    """Markers that swing by 5 mm along the body's z and come to rest, in the laboratory's frame."""
    rng = np.random.default_rng(36)
    time = np.linspace(0.0, 5.0, frames)
    swing = 5e-3 * np.exp(-4.0 * time) * np.cos(6.0 * time)
    found = {}
    for name, place in STATED.items():
        body = place + np.outer(swing, [0.0, 0.0, 1.0])
        found[name] = body @ TURN.T + SHIFT + noise * rng.standard_normal((frames, 3))
    return found


def write(path: Path, markers: dict[str, np.ndarray], unit: str = "mm", scale: float = 1e3) -> Path:
    names = [f"{m}_{axis}_{unit}" for m in markers for axis in "xyz"]
    time = np.linspace(0.0, 5.0, len(next(iter(markers.values()))))
    rows = [[f"{t:.6f}", *(f"{scale * v:.9g}" for m in markers.values() for v in m[k])]
            for k, t in enumerate(time)]  # fmt: skip
    lines = [",".join(["time_s", *names]), *(",".join(row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("cm", 1e2), ("m", 1.0)])
def test_tracks_are_read_in_metres_by_the_unit_of_their_columns(
    tmp_path: Path, unit: str, scale: float
) -> None:
    markers = tracks()
    found = read_tracks(write(tmp_path / "run.csv", markers, unit, scale))
    assert list(found.markers) == list(STATED)
    for name, track in markers.items():
        # Nine digits are written.
        assert found.markers[name] == pytest.approx(track, rel=1e-8)


def test_the_frame_and_the_places_at_rest_are_found_to_the_noise(tmp_path: Path) -> None:
    run = read_tracks(write(tmp_path / "run.csv", tracks()))
    rest = mean_place(run, 4.0, 5.0, limit=1e-4)
    frame = fit_frame(run.file, STATED, rest, limit=1e-3)
    assert np.linalg.det(frame.rotation) == pytest.approx(1.0, abs=1e-12)
    # Twenty frames are averaged; a rotation's lever is as long as the body.
    assert frame.rotation == pytest.approx(TURN, abs=4.0 * NOISE / 0.05)
    for name, place in STATED.items():
        assert frame.to_body(rest[name]) == pytest.approx(place, abs=2.0 * NOISE)


def test_a_mirrored_body_is_refused_and_not_mirrored_back() -> None:
    mirrored = {name: place * [1.0, 1.0, -1.0] for name, place in STATED.items()}
    with pytest.raises(FrameError, match="rms"):
        fit_frame("run.csv", STATED, mirrored, limit=1e-3)


def test_a_frame_that_does_not_fit_names_the_worst_marker() -> None:
    places = {**STATED, "d": STATED["d"] + [0.0, 0.0, 0.01]}
    with pytest.raises(FrameError, match=r"rms .* mm .* above 1 mm, most at d"):
        fit_frame("run.csv", STATED, places, limit=1e-3)


def test_markers_on_a_line_and_too_few_markers_make_no_frame() -> None:
    line = {name: np.array([x, 0.0, 0.0]) for name, x in (("a", 0.0), ("b", 0.1), ("c", 0.3))}
    with pytest.raises(FrameError, match="lie on a line"):
        fit_frame("run.csv", line, line, limit=1e-3)
    with pytest.raises(FrameError, match="x not measured"):
        fit_frame("run.csv", {"x": np.zeros(3)}, STATED, limit=1e-3)


def test_millimetres_read_as_metres_are_seen(tmp_path: Path) -> None:
    run = read_tracks(write(tmp_path / "run.csv", tracks(), "m", 1e3))
    with pytest.raises(LengthUnitError, match="1e\\+03 times"):
        fit_frame(run.file, STATED, mean_place(run, 4.0, 5.0, limit=1.0), limit=1e-3)


def test_labels_exchanged_throughout_are_named() -> None:
    places = {**STATED, "b": STATED["c"], "c": STATED["b"]}
    with pytest.raises(ExchangedLabelsError, match="b is the column c, c is the column b"):
        fit_frame("run.csv", STATED, places, limit=1e-3)


def test_labels_exchanged_from_some_time_on_are_named_with_it(tmp_path: Path) -> None:
    markers = tracks()
    b, c = markers["b"].copy(), markers["c"].copy()
    b[40:], c[40:] = markers["c"][40:], markers["b"][40:]
    with pytest.raises(ExchangedLabelsError, match=r"b and c change places after 1\.95 s"):
        read_tracks(write(tmp_path / "run.csv", {**markers, "b": b, "c": c}))


def test_a_gap_matters_within_the_window_only(tmp_path: Path) -> None:
    markers = tracks()
    markers["c"][30:33] = np.nan
    run = read_tracks(write(tmp_path / "run.csv", markers))
    assert len(run.between(3.0, 5.0).time) == 41
    with pytest.raises(GapError, match=r"marker c is lost in 3 of 101 frames, first at 1\.5 s"):
        run.between(0.0, 5.0)


def test_an_empty_window_says_what_the_file_has(tmp_path: Path) -> None:
    run = read_tracks(write(tmp_path / "run.csv", tracks()))
    with pytest.raises(EmptyWindowError, match="the file has 0 s to 5 s"):
        run.between(6.0, 7.0)


def test_a_run_that_still_swings_is_not_at_rest(tmp_path: Path) -> None:
    run = read_tracks(write(tmp_path / "run.csv", tracks()))
    with pytest.raises(RestlessError, match="marker a moves by"):
        mean_place(run, 0.0, 1.0, limit=1e-4)


def test_a_slow_drift_is_not_rest() -> None:
    time = np.linspace(0.0, 1.0, 101)
    track = np.outer(time, [0.0, 0.0, 1.5e-4])  # its spread, 0.043 mm, is below the limit
    with pytest.raises(RestlessError, match=r"moves by 0\.075"):
        mean_place(Tracks("run.csv", time, {"a": track}), 0.0, 1.0, limit=6e-5)


@pytest.mark.parametrize(
    ("head", "row", "reason"),
    [
        ("time_s,a_x_mm,a_x_mm,a_z_mm", "0,1,2,3", "column a_x_mm is there twice"),
        ("time_s,a_x_mm,a_x_cm,a_z_mm", "0,1,2,3", "marker a has two columns for x"),
        ("time_s,a_x_mm,a_y_mm", "0,1,2", "marker a has no column for z"),
        ("time_s,a_x_inch,a_y_mm,a_z_mm", "0,1,2,3", "column a_x_inch is not of a marker"),
        ("t,a_x_mm,a_y_mm,a_z_mm", "0,1,2,3", "is not of a marker|has no column time_s"),
        ("time_s,a_x_mm,a_y_mm,a_z_mm", "0,1,2", "line 2 has 3 cells for 4 columns"),
        ("time_s,a_x_mm,a_y_mm,a_z_mm", "0,1,lost,3", "column a_y_mm, line 2: 'lost' is no number"),
        ("time_s,a_x_mm,a_y_mm,a_z_mm", "0,1,2,3\n0,1,2,3", "time_s does not increase after 0 s"),
        ("time_s,a_x_mm,a_y_mm,a_z_mm", "", "has no frame"),
    ],
)
def test_columns_that_cannot_be_read_are_named(
    tmp_path: Path, head: str, row: str, reason: str
) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"{head}\n{row}\n", "utf-8")
    with pytest.raises(ColumnError, match=reason) as caught:
        read_tracks(path)
    assert caught.value.file == "run.csv"


def test_what_is_no_text_and_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("run.csv", "none.csv"):
        with pytest.raises(MeasurementError, match="cannot be read as CSV"):
            read_tracks(tmp_path / name)


def test_the_scatter_of_runs_is_that_of_their_noise() -> None:
    rng = np.random.default_rng(5)
    runs = 2.0 + 0.1 * rng.standard_normal((2, 500, 3))
    found = mean_of_runs(list(runs))
    assert found.degrees == 1500
    # Of 1500 degrees of freedom, it is known to 1 / sqrt(3000) = 1.8 %: four times that.
    assert found.uncertainty == pytest.approx(0.1 / np.sqrt(2.0), rel=4 * 0.018)
    assert found.mean == pytest.approx(runs.mean(axis=0), rel=1e-15)
    third = 3.0 * runs.mean(axis=0) - runs.sum(axis=0)
    assert mean_of_runs([*runs, third]).degrees == 3000
    with pytest.raises(InputError, match="state the uncertainty"):
        mean_of_runs([runs[0]])


# In a process of its own: SWIG's modules in one process share their tables of types.
C3D = """
import sys
import ezc3d
import numpy as np

path, unit, *labels = sys.argv[1:]
data = ezc3d.c3d()
about = data["parameters"]["POINT"]
about["RATE"]["value"], about["UNITS"]["value"] = [50.0], [unit]
about["LABELS"]["value"] = labels
points = np.ones((4, len(labels), 6))
for k in range(len(labels)):
    points[:3, k] = np.array([10.0, 20.0 + 100.0 * k, 30.0])[:, None] + np.arange(6)
residuals = np.zeros((1, len(labels), 6))
residuals[0, 0, 3] = -1.0
data["data"]["points"] = points
data["data"]["meta_points"]["residuals"] = residuals
data.write(path)
"""


def c3d_file(path: Path, *, unit: str = "mm", labels: tuple[str, ...] = ("tip", "left")) -> Path:
    if importlib.util.find_spec("ezc3d") is None:
        pytest.skip("ezc3d is not installed")
    subprocess.run([sys.executable, "-c", C3D, path, unit, *labels], check=True)
    return path


def test_motion_capture_is_read(tmp_path: Path) -> None:
    found = read_tracks(c3d_file(tmp_path / "walk.c3d"))
    assert list(found.markers) == ["tip", "left"]
    assert np.diff(found.time) == pytest.approx(np.full(5, 0.02))
    assert found.markers["left"][2] == pytest.approx([0.012, 0.122, 0.032], rel=1e-6)
    lost = ~np.isfinite(found.markers["tip"]).all(axis=1)
    assert list(np.flatnonzero(lost)) == [3]
    with pytest.raises(GapError, match="marker tip is lost in 1 of 6 frames"):
        found.between(0.0, 1.0)


def test_motion_capture_that_cannot_be_used_says_why(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="its unit is 'inch'"):
        read_tracks(c3d_file(tmp_path / "a.c3d", unit="inch"))
    with pytest.raises(ColumnError, match="marker tip is there twice"):
        read_tracks(c3d_file(tmp_path / "b.c3d", labels=("tip", "tip")))
    whole = c3d_file(tmp_path / "c.c3d").read_bytes()
    rng = np.random.default_rng(3)
    for number, text in enumerate(
        (b"", b"no C3D at all", whole[:300], whole[:520], rng.bytes(4000), whole[:-40])
    ):
        path = tmp_path / f"damaged{number}.c3d"
        path.write_bytes(text)
        try:
            read_tracks(path)
        except MeasurementError as error:
            assert path.name in str(error)  # noqa: PT017
        else:
            assert number == 5  # what is cut off at its end may be padding
