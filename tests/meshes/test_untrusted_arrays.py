"""Arrays of others: as numpy reads them, or a refusal before anything is unpacked."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted_arrays import read_npz


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
    for place in range(0, len(whole), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
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
    place = data.rfind(b"PK\x01\x02") + 24  # the uncompressed size in the central directory
    struct.pack_into("<I", data, place, 10_000)
    short.write_bytes(bytes(data))
    with pytest.raises(FileFormatError):
        read_npz(short)
