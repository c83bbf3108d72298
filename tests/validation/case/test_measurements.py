"""Measurements of a case: what is read, and what is refused with a word on what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_bars import FORCE_CURVE, MARKERS, case_text, write_tracks

from palpate.meshes.errors import InputError
from palpate.validation.case import CaseError, load_case
from palpate.validation.case.measurements import pins_of, read_measurements
from palpate.validation.metrics.measured_tracks import (
    ColumnError,
    EmptyWindowError,
    FrameError,
    LengthUnitError,
    MeasurementError,
    RestlessError,
)

DROP = np.array([[1.0, 0.0, -20.0], [0.5, 0.1, -19.0], [0.2, 0.0, -7.0]])
FREQUENCY = """
[[measurement]]
name = "swing"
kind = "frequency"
files = ["swing.csv"]
markers = ["above"]
component = "z"
uncertainty = 0.01
"""
CURVE = (
    """
[[tool]]
shape = "sphere"
radius = 10.0
pose = [
  { time = 0.0, position = [50.0, 10.0, 30.1] },
  { time = 1.0, position = [50.0, 10.0, 26.1] },
]
"""
    + FORCE_CURVE
)


@pytest.fixture
def bar(tmp_path: Path) -> Callable[..., Path]:
    """Write the case with two runs of each experiment; returns its path."""

    def write(more: str = "", *changes: tuple[str, str]) -> Path:
        for name, factor in (("hung", 1.0), ("bare", 0.5)):
            for run, off in ((1, 0.1), (2, -0.1)):
                moved = dict(zip(MARKERS, factor * DROP + off, strict=True))
                write_tracks(tmp_path / f"{name}_{run}.csv", moved)
        text = case_text(more)
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "bar.toml").write_text(text, "utf-8")
        return tmp_path / "bar.toml"

    return write


def test_runs_become_a_mean_and_their_scatter(bar: Callable[..., Path]) -> None:
    found = read_measurements(load_case(bar()))
    assert list(found) == ["hung", "bare"]
    hung = found["hung"]
    # 0.1 mm either way, with one degree of freedom each: 0.1 sqrt(2) of a run, 0.1 of two.
    assert 1e3 * hung.uncertainty == pytest.approx([0.1] * 9, rel=1e-6)
    assert 1e3 * hung.values == pytest.approx(DROP.ravel(), abs=1e-6)
    assert hung.labels[:3] == ("above x", "above y", "above z")
    assert 1e3 * found["bare"].values == pytest.approx(0.5 * DROP.ravel(), abs=1e-6)
    alone = hung.with_runs([1])
    assert 1e3 * alone.values == pytest.approx(DROP.ravel() - 0.1, abs=1e-6)
    assert alone.uncertainty == pytest.approx(np.sqrt(2.0) * hung.uncertainty)


def test_an_experiment_has_its_own_numbers_and_the_others_of_the_case(
    bar: Callable[..., Path],
) -> None:
    found = read_measurements(load_case(bar()))
    assert len(found["hung"].at({}).problem.masses) == 1
    masses = {name: one.at({"mass[0].mass": 25.0}).problem.masses for name, one in found.items()}
    assert [m.mass for m in masses["hung"]] == [0.025]
    assert sum(m.mass for m in masses["bare"]) == 0.0  # its own number counts


def test_an_experiment_of_another_shape_has_its_own_mesh(bar: Callable[..., Path]) -> None:
    change = ('"mass[0].mass" = 0.0', '"geometry.size[0]" = 95.0')
    case = load_case(bar("", change))
    found = read_measurements(case)
    assert found["hung"].at({}, like=case).mesh is case.mesh
    other = found["bare"].at({}, like=case)
    assert np.ptp(other.problem.mesh.points[:, 0]) == pytest.approx(0.095)
    assert found["bare"].at({"material.density": 900.0}, like=other).mesh is other.mesh


def test_the_laboratory_may_be_turned(bar: Callable[..., Path], tmp_path: Path) -> None:
    path = bar()
    plain = read_measurements(load_case(path), ["hung"])["hung"].values
    turn = np.array([[0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.8, 0.0, 0.6]])
    for run, off in ((1, 0.1), (2, -0.1)):
        lines = (tmp_path / f"hung_{run}.csv").read_text("utf-8").splitlines()
        rows = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
        places = rows[:, 1:].reshape(len(rows), -1, 3) @ turn.T + [5.0, -7.0, 11.0 + off]
        rows[:, 1:] = places.reshape(len(rows), -1)
        text = "\n".join([lines[0], *(",".join(f"{x:.9f}" for x in row) for row in rows)])
        (tmp_path / f"hung_{run}.csv").write_text(text, "utf-8")
    turned = read_measurements(load_case(path), ["hung"])["hung"].values
    assert turned == pytest.approx(plain, abs=1e-9)


def test_a_frequency_is_that_of_the_swing(bar: Callable[..., Path], tmp_path: Path) -> None:
    path = bar(FREQUENCY)
    time = np.arange(0.0, 2.0, 0.01)
    z = 26.0 + 3.0 * np.exp(-0.8 * time) * np.cos(2.0 * np.pi * 4.2 * time + 0.3)
    rows = [f"{t:.2f},100,10,{x:.9f}" for t, x in zip(time, z, strict=True)]
    (tmp_path / "swing.csv").write_text(
        "\n".join(["time_s,above_x_mm,above_y_mm,above_z_mm", *rows]), "utf-8"
    )
    swing = read_measurements(load_case(path), ["swing"])["swing"]
    assert swing.values == pytest.approx([4.2], rel=1e-6)
    assert swing.uncertainty == pytest.approx([0.01], rel=1e-3)
    assert swing.unit == (1.0, "Hz")
    still = ["time_s,above_x_mm,above_y_mm,above_z_mm", *(f"{t:.2f},100,10,26" for t in time)]
    (tmp_path / "swing.csv").write_text("\n".join(still), "utf-8")
    with pytest.raises(MeasurementError, match="does not oscillate"):
        read_measurements(load_case(path), ["swing"])


def test_a_curve_has_its_depths(bar: Callable[..., Path], tmp_path: Path) -> None:
    path = bar(CURVE)
    (tmp_path / "press.csv").write_text("depth_mm,force_mN\n1,2\n3.5,20\n", "utf-8")
    press = read_measurements(load_case(path), ["press"])["press"]
    assert press.depths == pytest.approx([0.001, 0.0035])
    assert press.values == pytest.approx([0.002, 0.020])
    assert press.labels == ("at 1 mm", "at 3.5 mm")


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("depth_mm,force\n1,2\n", ColumnError, "one column force_UNIT"),
        ("depth_mm,force_N\n2,2\n1,3\n", ColumnError, "must be above 0 and increase"),
        ("depth_mm,force_N\n1,x\n", ColumnError, "column force_N has a cell"),
        ("depth_mm,force_N\n1,nan\n", ColumnError, "not finite"),
        ("depth_mm,force_N\n", EmptyWindowError, "no rows of numbers"),
        ("", ColumnError, "it has none"),
        ("depth_mm,force_N\n1,2\n9,3\n", InputError, "lengthen the path"),
    ],
)
def test_a_curve_that_cannot_be_used_says_why(
    bar: Callable[..., Path], tmp_path: Path, text: str, kind: type[Exception], says: str
) -> None:
    path = bar(CURVE)
    (tmp_path / "press.csv").write_text(text, "utf-8")
    with pytest.raises(kind, match=says):
        read_measurements(load_case(path), ["press"])


@pytest.mark.parametrize(
    ("change", "kind", "says"),
    [
        (("start = 1.0", "start = 9.0"), EmptyWindowError, "state a window"),
        (("start = 1.0", "start = 0.0"), RestlessError, "state a later window"),
        (("position = [100.0, 10.0, 26.0]", "position = [90.0, 10.0, 26.0]"), FrameError,
         "above 1 mm"),
        (('length = "mm"', 'length = "cm"'), LengthUnitError, "correct the unit"),
        (('"mass[0].mass" = 0.0', '"mass[1].mass" = 0.0'), InputError,
         "did you mean 'mass\\[0\\].mass'"),
        (('files = ["hung_1.csv", "hung_2.csv"]', 'files = ["hung_1.csv", "lost.csv"]'),
         InputError, "lost.csv: no such file beside the case"),
        (('files = ["hung_1.csv", "hung_2.csv"]', 'files = ["hung_1.csv", "../x.csv"]'),
         InputError, "outside"),
    ],
)  # fmt: skip
def test_a_measurement_that_cannot_be_used_says_why(
    bar: Callable[..., Path], change: tuple[str, str], kind: type[Exception], says: str
) -> None:
    with pytest.raises(kind, match=says):
        read_measurements(load_case(bar("", change)))


def test_a_column_that_is_missing_is_named(bar: Callable[..., Path], tmp_path: Path) -> None:
    path = bar()
    text = (tmp_path / "hung_2.csv").read_text("utf-8").replace("middle_", "center_")
    (tmp_path / "hung_2.csv").write_text(text, "utf-8")
    with pytest.raises(ColumnError, match=r"no columns middle_x_mm .* above, left, center"):
        read_measurements(load_case(path))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('markers = ["above", "left", "middle"]', 'markers = ["low"]'), "no \\[\\[marker"),
        (("limit = 2.0", "#"), "a limit needs its reason"),
        (("rest_limit = 0.5", "#"), "needs rest_limit"),
        (("rest_limit = 0.5", 'rest_limit = 0.5\ncomponent = "z"'), "component does not go with"),
        (("start = 1.0", "start = 1.0\nend = 0.5"), "start must be before end"),
        (('files = ["hung_1.csv", "hung_2.csv"]', 'files = ["hung_1.csv"]'), "its uncertainty"),
        (('name = "bare"', 'name = "hung"'), "two \\[\\[measurement\\]\\] are named"),
        (('name = "middle"', 'name = "left"'), "two \\[\\[marker\\]\\] are named"),
        (("frame_limit = 1.0", "#"), "a frame_limit"),
        (('frame = ["above", "left", "middle"]', 'frame = ["above", "left"]'), "three different"),
        (("radius = 6.0", "#"), "is compared, and needs a radius"),
        (("[[check]]", "[time]\nend_time = 1.0\n[[check]]"), "a case without \\[time\\]"),
    ],
)  # fmt: skip
def test_a_table_that_makes_no_sense_is_refused(
    bar: Callable[..., Path], change: tuple[str, str], says: str
) -> None:
    with pytest.raises(CaseError, match=says):
        load_case(bar("", change))


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ('inputs = ["material.density"]\nstandard = [1.0, 2.0]', "one standard uncertainty"),
        ('inputs = ["material.density"]\nstandard = [1.0]\ncorrelation = [[0.5]]',
         "1 in its diagonal"),
        ('inputs = ["material.density"]\nstandard = [1.0]\ncorrelation = [[1.0, 0.0]]',
         "needs 1 rows"),
    ],
)  # fmt: skip
def test_an_uncertainty_that_makes_no_sense_is_refused(
    bar: Callable[..., Path], table: str, says: str
) -> None:
    with pytest.raises(CaseError, match=says):
        load_case(bar(f'[[uncertainty]]\n{table}\nsource = "x"\n'))


def test_pins_stick_to_the_body(bar: Callable[..., Path]) -> None:
    case = load_case(bar())
    for name, pin in pins_of(case, tuple(MARKERS)).items():
        assert 1e3 * pin.position == pytest.approx(MARKERS[name])
        assert len(pin.points) >= 6


def test_a_pin_turns_with_the_face_it_sticks_to(bar: Callable[..., Path]) -> None:
    case = load_case(bar())
    turn, shift = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [0.01, 0.02, 0.03]
    rest = case.problem.mesh.points
    for pin in pins_of(case, tuple(MARKERS)).values():
        found = pin.moved(rest, rest @ turn.T + shift - rest)
        assert found == pytest.approx(turn @ pin.position + shift - pin.position, abs=1e-14)


def test_check_reads_what_was_measured(bar: Callable[..., Path], palpate_run: Callable) -> None:
    ended = palpate_run("check", bar())
    assert ended.returncode == 0, ended.stderr
    assert "hung: 9 value(s), 2 run(s), at most 20 mm, standard uncertainty 0.1" in ended.stdout


def test_a_curve_that_is_no_text_is_named(bar: Callable[..., Path], tmp_path: Path) -> None:
    path = bar(CURVE)
    (tmp_path / "press.csv").write_bytes(b"\xff\xfe\x00depth")
    with pytest.raises(MeasurementError, match=r"press\.csv: cannot be read as CSV"):
        read_measurements(load_case(path), ["press"])


def test_nothing_swings_freely_under_a_tool(bar: Callable[..., Path]) -> None:
    with pytest.raises(CaseError, match="a frequency is of a case without"):
        load_case(bar(FREQUENCY + CURVE))
