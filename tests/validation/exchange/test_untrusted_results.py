"""What a result says beside its numbers, and damage in its data: refused, never an inner error."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError
from palpate.meshes.files import write_mesh
from palpate.meshes.problem import Problem, Strain
from palpate.validation.candidates.candidate import result_candidate
from palpate.validation.exchange.result_files import ResultFileError, read_result, room_for_answer

Field = NDArray[np.float64]


def npz(folder: Path, **arrays: Any) -> Path:
    np.savez_compressed(folder / "r.npz", **arrays)
    return folder / "r.npz"


@pytest.mark.parametrize(
    "times", [[math.nan], [math.inf], [0.0, math.nan], [0.0, math.inf], [[0.0]]]
)
def test_times_that_are_no_times_are_refused(
    tmp_path: Path, answer: Field, times: list[float]
) -> None:
    path = npz(tmp_path, displacement=np.stack([answer] * len(times)), times=times)
    if times != [[0.0]]:
        with pytest.raises(ResultFileError, match="finite"):
            read_result(path)
    else:
        with pytest.raises(ResultFileError):
            read_result(path)


@pytest.mark.parametrize(
    "forces",
    ["many", ["a", "b", "c"], [["1", "2", "3"]], [[1.0, 2.0], [3.0]], [1.0, 2.0, 3.0], {"x": 1},
     [[1.0, 2.0]], [[[[1.0, 2.0, 3.0]]]], True, [[True, False, True]], 7],
)  # fmt: skip
def test_tool_forces_that_are_no_forces_are_refused(
    tmp_path: Path, problem: Problem, answer: Field, forces: Any
) -> None:
    path = npz(tmp_path, displacement=answer, about=json.dumps({"tool_forces": forces}))
    with pytest.raises(ResultFileError, match="tool_forces"):
        result_candidate(path).solve(problem, Strain.GREEN, lambda _line: None)


def test_tool_forces_with_a_nan_are_read_as_they_are(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    path = npz(tmp_path, displacement=answer, about='{"tool_forces": [[NaN, 0, 1]]}')
    state = result_candidate(path).solve(problem, Strain.GREEN, lambda _line: None)
    assert state.tool_forces is not None
    assert np.isnan(state.tool_forces[0, 0])


@pytest.mark.parametrize(
    "about",
    ["[1]", "7", '"text"', "null", "{", "[" * 2000, '{"a": ' * 1000 + "1" + "}" * 1000,
     '{"a": 1' + "0" * 400 + "}"],
)  # fmt: skip
def test_an_about_that_is_no_object_is_refused(tmp_path: Path, answer: Field, about: str) -> None:
    with pytest.raises(ResultFileError, match="about"):
        read_result(npz(tmp_path, displacement=answer, about=about))


@pytest.mark.parametrize("name", ["about", "length_unit", "case_key"])
@pytest.mark.parametrize("value", [np.arange(3), np.array(["a", "b"]), np.zeros((0,), "U1")])
def test_text_that_is_no_text_is_refused(
    tmp_path: Path, answer: Field, name: str, value: Any
) -> None:
    with pytest.raises(ResultFileError, match=name):
        read_result(npz(tmp_path, displacement=answer, **{name: value}))


def test_fields_of_a_vtu_called_as_texts_are_refused(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    for name in ("about", "length_unit", "times", "original_id"):
        path = tmp_path / f"{name}.vtu"
        fields = {"displacement": answer, name: answer[:, 0]}
        write_mesh(path, problem.mesh, point_data=fields)
        with pytest.raises(ResultFileError):
            read_result(path)


def test_a_damaged_stream_is_refused_in_npz_and_vtu(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    zipped = npz(tmp_path, displacement=answer)
    middle = zipped.stat().st_size // 2
    data = bytearray(zipped.read_bytes())
    data[middle : middle + 8] = b"\xff" * 8
    zipped.write_bytes(bytes(data))
    write_mesh(tmp_path / "r.vtu", problem.mesh, point_data={"displacement": answer})
    text = (tmp_path / "r.vtu").read_text("ascii")
    longest = max(re.findall(r"[A-Za-z0-9+/=]{60,}", text), key=len)
    broken = longest[:50] + "/" * 12 + longest[62:]
    (tmp_path / "r.vtu").write_text(text.replace(longest, broken), encoding="ascii")
    for path in (zipped, tmp_path / "r.vtu"):
        with pytest.raises(ResultFileError, match="cannot be read"):
            read_result(path)


def test_a_result_may_be_many_times_as_large_as_the_cases_own(
    tmp_path: Path, problem: Problem, answer: Field
) -> None:
    assert room_for_answer(problem) == 256 * 1024**2
    path = npz(tmp_path, displacement=answer)
    read_result(path, most_bytes=answer.nbytes)
    with pytest.raises(ResultFileError, match="when unpacked"):
        read_result(path, most_bytes=answer.nbytes - 1)


def test_the_names_that_are_there_are_told_where_the_wanted_ones_are_not(
    tmp_path: Path, answer: Field
) -> None:
    with pytest.raises(ResultFileError, match="it holds: 'displacements'"):
        read_result(npz(tmp_path, displacements=answer))


def test_whole_numbers_beyond_what_a_float_counts_are_refused(
    tmp_path: Path, answer: Field
) -> None:
    for value in (2.0**53, 1e300, -1e300):
        ids = np.full(len(answer), value)
        with pytest.raises(FileFormatError, match="no whole number"):
            read_result(npz(tmp_path, displacement=answer, original_id=ids))
