"""Files of others: what they hold, or a refusal before anything large is read or unpacked."""

from __future__ import annotations

import io
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted import (
    DEEPEST,
    UntrustedTextError,
    parse_json,
    parse_toml,
    read_npz,
    read_text,
)


def test_plain_data_comes_through() -> None:
    assert parse_json('{"a": [1, 2.5, null, true, "x"]}') == {"a": [1, 2.5, None, True, "x"]}
    assert parse_toml('a = [1, 2.5, true]\n[b]\nc = "x"') == {"a": [1, 2.5, True], "b": {"c": "x"}}


@pytest.mark.parametrize("depth", [DEEPEST + 1, 1000, 100_000])
@pytest.mark.parametrize(
    ("parse", "opening", "inner", "closing"),
    [
        (parse_json, "[", "1", "]"),
        (parse_json, '{"a":', "1", "}"),
        (parse_toml, "[", "1", "]"),
        (parse_toml, "{a=", "1", "}"),
    ],
)
def test_deep_nesting_is_refused(
    parse: object, opening: str, inner: str, closing: str, depth: int
) -> None:
    text = opening * depth + inner + closing * depth
    assert callable(parse)
    with pytest.raises(UntrustedTextError, match="nested"):
        parse(text if parse is parse_json else f"x = {text}")


def test_a_key_of_a_thousand_parts_is_deep_too() -> None:
    with pytest.raises(UntrustedTextError, match="nested"):
        parse_toml(".".join(["a"] * 1000) + " = 1")


@pytest.mark.parametrize("text", ["NaN", "[Infinity]", '{"a": -Infinity}', "1e999", "[[-1e400]]"])
def test_numbers_without_end_are_no_json_unless_they_are_expected(text: str) -> None:
    with pytest.raises(UntrustedTextError):
        parse_json(text)
    parse_json(text, allow_nan=True)


@pytest.mark.parametrize("digits", [400, 5000])
def test_whole_numbers_that_no_float_holds_are_refused(digits: int) -> None:
    for allow_nan in (True, False):
        with pytest.raises(UntrustedTextError):
            parse_json("1" * digits, allow_nan=allow_nan)


def test_what_is_no_plain_file_of_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "large").write_bytes(b"x" * 101)
    os.mkfifo(tmp_path / "pipe")
    for name in ("loop", "bytes", "missing", "pipe", "large", ".", "a\0b"):
        with pytest.raises(FileFormatError):
            read_text(tmp_path / name, most_bytes=100)


def npy_header(shape: tuple[int, ...], descr: str = "<f8", order: bool = False) -> bytes:
    stream = io.BytesIO()
    text = {"descr": descr, "fortran_order": order, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, text)  # type: ignore[arg-type]
    return stream.getvalue()


def zipped(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return path


def test_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    arrays = {
        "plain": np.arange(12.0).reshape(4, 3),
        "columns_first": np.asfortranarray(np.arange(12.0).reshape(4, 3)),
        "whole": np.arange(5, dtype=np.int32),
        "text": np.array("about"),
        "empty": np.zeros((0, 3)),
        "truth": np.array([True, False]),
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
        found = read_npz(tmp_path / "a.npz")
        assert set(found) == set(arrays)
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)
            assert found[name].shape == array.shape


def test_only_the_named_arrays_are_read(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.npz", good=npy_header((1,)) + b"\0" * 8, huge=npy_header((10**15,)))
    assert list(read_npz(path, names=("good",))) == ["good"]
    with pytest.raises(FileFormatError, match="when unpacked"):
        read_npz(path)


@pytest.mark.parametrize(
    "header",
    [
        npy_header((10**15, 3)),
        npy_header((2**62, 2**62)),
        npy_header((1,), "<U500000000"),
        npy_header((10**15,), "<U0"),
        npy_header((-1, 3)),
        npy_header((4,), "|O"),
        npy_header((4,), "<M8[s]"),
        npy_header((4,)).replace(b"(4,)", b"(4.)"),
        npy_header((4,)).replace(b"'shape'", b"'shqpe'"),
        npy_header((4,))[:40],
        b"",
    ],
)
def test_headers_that_cannot_be_are_refused(tmp_path: Path, header: bytes) -> None:
    with pytest.raises(FileFormatError):
        read_npz(zipped(tmp_path / "a.npz", x=header + b"\0" * 32), most_bytes=10**6)


def test_the_sum_of_all_arrays_is_judged(tmp_path: Path) -> None:
    members = {f"x{k}": npy_header((1000,)) + b"\0" * 8000 for k in range(10)}
    path = zipped(tmp_path / "a.npz", **members)
    assert len(read_npz(path, most_bytes=80_000)) == 10
    with pytest.raises(FileFormatError, match="when unpacked"):
        read_npz(path, most_bytes=79_999)


def test_every_damaged_byte_is_a_refusal_or_the_same_arrays(tmp_path: Path) -> None:
    array = np.random.default_rng(1).normal(size=(20, 3))
    np.savez_compressed(tmp_path / "a.npz", x=array)
    whole = (tmp_path / "a.npz").read_bytes()
    refused = 0
    for position in range(0, len(whole), 3):
        damaged = bytearray(whole)
        damaged[position] ^= 0xFF
        (tmp_path / "b.npz").write_bytes(bytes(damaged))
        try:
            found = read_npz(tmp_path / "b.npz")
        except FileFormatError:
            refused += 1
            continue
        for values in found.values():
            np.testing.assert_array_equal(values, array)
    # Nearly all bytes are the data itself, which a checksum guards.
    assert refused > len(whole) / 3 / 2


def test_a_size_that_the_zip_file_lies_about_does_not_help(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.npz", x=npy_header((4,)) + b"\0" * 10_000_000)
    found = read_npz(path, most_bytes=10_000)
    assert found["x"].shape == (4,)
    short = zipped(tmp_path / "b.npz", x=npy_header((100,)) + b"\0" * 8)
    with pytest.raises(FileFormatError, match="shorter"):
        read_npz(short)
    data = bytearray(short.read_bytes())
    position = data.rfind(b"PK\x01\x02") + 24  # the uncompressed size in the central directory
    struct.pack_into("<I", data, position, 10_000)
    short.write_bytes(bytes(data))
    with pytest.raises(FileFormatError):
        read_npz(short)
