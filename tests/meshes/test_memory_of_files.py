"""Small files that stand for large ones are refused without the memory they ask for.

Each is read in a process of its own, which tells the most memory it ever held.
"""

from __future__ import annotations

import base64
import io
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from limits import PRINT_MOST_MEMORY

# A process with numpy and meshio holds some 0.1 GB; each file asks for 1.5 GB or more.
MOST = 700e6
READ = """
import sys
from palpate.meshes.errors import FileFormatError
from palpate.meshes.files import read_mesh
from palpate.meshes.untrusted import read_npz
from palpate.validation.exchange.result_files import read_result
read = {"read_mesh": read_mesh, "read_npz": read_npz, "read_result": read_result}[sys.argv[1]]
try:
    read(sys.argv[2])
    print("read")
except FileFormatError as error:
    print("refused", error)
"""
HUGE, PIECE = 3 * 2**29, 2**24


def read_in_a_process(how: str, path: Path) -> tuple[str, float]:
    done = subprocess.run(
        [sys.executable, "-c", READ + PRINT_MOST_MEMORY, how, str(path)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    reported, peak = done.stdout.strip().splitlines()
    return reported, float(peak)


def packed_zeros() -> bytes:
    """HUGE zeros, deflated: a thousandth of them. One piece after a full flush, many times."""
    packer, piece = zlib.compressobj(9), bytes(PIECE)
    start = packer.compress(piece) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(piece) + packer.flush(zlib.Z_FULL_FLUSH)
    # The sum that ends the stream is wrong: found only by who has unpacked all of it.
    return start + again * (HUGE // PIECE - 1) + packer.flush()


def npz(folder: Path, name: str) -> Path:
    header = io.BytesIO()
    shape = (HUGE // 24, 3)
    np.lib.format.write_array_header_1_0(
        header,
        {"descr": "<f8", "fortran_order": False, "shape": shape},  # type: ignore[arg-type]
    )
    path, piece = folder / "bomb.npz", bytes(PIECE)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(f"{name}.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(header.getvalue())
        for _ in range(HUGE // PIECE):
            stream.write(piece)
    return path


VTU = """<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" header_type="UInt64"
 compressor="vtkZLibDataCompressor"><UnstructuredGrid>
<Piece NumberOfPoints="{points}" NumberOfCells="1">
<Points><DataArray type="Float64" NumberOfComponents="3" format="{format}" {offset}>{data}
</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>
<DataArray type="Int64" Name="types" format="ascii">10</DataArray></Cells>
</Piece></UnstructuredGrid>{appended}</VTKFile>
"""


def vtu(folder: Path, *, declared: int, points: int, format: str = "binary") -> Path:
    """Of 1.5 GB of zeros as the points; `declared` is what the block's header says of it."""
    block = packed_zeros()
    header = np.array([1, declared, declared, len(block)], dtype="<u8").tobytes()
    data = (base64.b64encode(header) + base64.b64encode(block)).decode("ascii")
    raw = f'<AppendedData encoding="raw">_{"RAW"}\n</AppendedData>'
    appended = f'<AppendedData encoding="base64">_{data}</AppendedData>'
    text = VTU.format(
        points=points,
        format="binary" if format == "binary" else "appended",
        offset="" if format == "binary" else 'offset="0"',
        data=data if format == "binary" else "",
        appended={"binary": "", "base64": appended, "raw": raw}[format],
    )
    path = folder / "bomb.vtu"
    path.write_bytes(text.encode("ascii").replace(b"RAW", header + block))
    return path


def msh2(folder: Path, tag: str) -> Path:
    nodes = [f"{tag} 0 0 0", "2 1 0 0", "3 0 1 0", "4 0 0 1"]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", "4", *nodes, "$EndNodes"]
    lines += ["$Elements", "1", "1 4 2 0 1 1 2 3 4", "$EndElements", ""]
    path = folder / "tags.msh"
    path.write_text("\n".join(lines), encoding="ascii")
    return path


def msh4(folder: Path, tag: str) -> Path:
    nodes = ["1 4 1 4", "3 1 0 4", tag, "2", "3", "4", "0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$Nodes", *nodes, "$EndNodes"]
    lines += ["$Elements", "1 1 1 1", "3 1 4 1", "1 1 2 3 4", "$EndElements", ""]
    path = folder / "tags.msh"
    path.write_text("\n".join(lines), encoding="ascii")
    return path


def msh_data(folder: Path) -> Path:
    """Text tags without end."""
    path = msh2(folder, "1")
    path.write_text(path.read_text("ascii") + "$NodeData\n1000000000000\n", encoding="ascii")
    return path


@pytest.mark.parametrize(
    ("how", "write"),
    [
        ("read_npz", lambda folder: npz(folder, "x")),
        ("read_result", lambda folder: npz(folder, "displacement")),
        ("read_result", lambda folder: vtu(folder, declared=HUGE, points=HUGE // 24)),
        ("read_mesh", lambda folder: vtu(folder, declared=HUGE, points=HUGE // 24)),
        ("read_mesh", lambda folder: vtu(folder, declared=HUGE, points=4)),
        ("read_mesh", lambda folder: vtu(folder, declared=96, points=4)),
        ("read_mesh", lambda folder: vtu(folder, declared=96, points=4, format="base64")),
        ("read_mesh", lambda folder: vtu(folder, declared=96, points=4, format="raw")),
        ("read_mesh", lambda folder: msh2(folder, "1e308")),
        ("read_mesh", lambda folder: msh2(folder, "2147483647")),
        ("read_mesh", lambda folder: msh4(folder, "4294967296")),
        ("read_mesh", msh_data),
    ],
)
@pytest.mark.long
def test_a_hostile_file_is_refused_in_little_memory(
    tmp_path: Path, how: str, write: Callable[[Path], Path]
) -> None:
    path = write(tmp_path)
    assert path.stat().st_size < 20e6
    reported, peak = read_in_a_process(how, path)
    assert reported.startswith("refused")
    assert peak < MOST


def test_the_same_files_without_the_lie_are_read(tmp_path: Path) -> None:
    for write in (msh2, msh4):
        reported, peak = read_in_a_process("read_mesh", write(tmp_path, "1"))
        assert reported == "read"
        assert peak < MOST
