"""The kernels compile for GPUs on a machine without one, and compute with no double by accident.

Registers of 32 bits that a thread has on Hopper (sm_90), of at most 255, by CUDA 13.4's assembler:

                          float32   float64
    force_cells                56        90
    force_smoothed_cells       48        66
    gather_forces              32        40
    move_points                32        32
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path

import pytest

from palpate.fastsim.gpu.devices import WARP_CPU, load_warp
from palpate.fastsim.gpu.kernels.kit import IN_DOUBLE, TOPICS
from palpate.fastsim.gpu.launches import kernels_of

pytest.importorskip("warp", reason="the extra `gpu` is not installed")
KERNELS = {
    "elasticity": {"force_cells"},
    "smoothing": {"strain_cells", "smooth_edges", "smooth_nodes", "force_smoothed_cells"},
    "gathering": {"gather_forces"},
    "stepping": {"move_points", "finish_step"},
}


_ENTRY = re.compile(r"\.entry\s+(\w+)\s*\(")
_REGISTERS = re.compile(r"\.reg\s+\.(b16|b32|b64|f32|f64)\s+%\w+<(\d+)>")
_DOUBLE = re.compile(r"^\s*(?:@\S+\s+)?[a-z]\S*\.f64\S*\s.*$", re.MULTILINE)


@dataclass(frozen=True)
class KernelPtx:
    """A kernel as compiled for an architecture.

    Attributes:
        name: As in `kernels/`.
        doubles: Instructions on numbers of double precision.
        virtual_registers: By kind ("f32", "f64", "b32", ...), as PTX declares them: one for each
            value ever computed, so not what a thread takes (see `registers`), but which kinds of
            numbers it computes with.
    """

    name: str
    doubles: tuple[str, ...]
    virtual_registers: dict[str, int]


def compile_topic(
    topic: str, precision: str, architecture: int, folder: Path, *, is_ptx: bool = True
) -> Path:
    """A topic's kernels, compiled into a file in a folder; needs no GPU.

    Args:
        topic: One of `kernels.kit.TOPICS`.
        precision: "float32" or "float64".
        architecture: 80, 90 or 100, ...
        folder: Made where it is not there.
        is_ptx: PTX; else machine code of that architecture.

    Raises:
        DeviceUnavailableError: Warp is not installed.
    """
    if topic not in TOPICS:
        raise KeyError(topic)
    wp = load_warp(WARP_CPU)
    module = kernels_of(wp, precision).modules[topic]
    folder.mkdir(parents=True, exist_ok=True)
    paths = wp.compile_aot_module(module, arch=architecture, module_dir=folder, use_ptx=is_ptx)
    suffix = ".ptx" if is_ptx else ".cubin"
    return next(Path(path) for path in paths if str(path).endswith(suffix))


def read_ptx(path: Path) -> list[KernelPtx]:
    """The kernels of a PTX file."""
    text = path.read_text("utf-8", errors="replace")
    begins = list(_ENTRY.finditer(text))
    found = []
    before = tuple(_DOUBLE.findall(text[: begins[0].start() if begins else len(text)]))
    if before:
        found.append(KernelPtx("(functions)", before, {}))
    for begin, end in zip(begins, [*begins[1:], None], strict=True):
        body = text[begin.end() : len(text) if end is None else end.start()]
        counts: dict[str, int] = {}
        for kind, count in _REGISTERS.findall(body):
            counts[kind] = counts.get(kind, 0) + int(count) - 1
        name = _plain(begin.group(1))
        doubles = tuple(line.strip() for line in _DOUBLE.findall(body))
        found.append(KernelPtx(name, doubles, counts))
    return found


def registers(path: Path) -> dict[str, int]:
    """Registers of 32 bits that a thread of each kernel takes, by a file of machine code.

    They stand in its section .nv.info, an entry (4, 0x2f) for each kernel: symbol and count.
    """
    data = path.read_bytes()
    (table,) = struct.unpack_from("<Q", data, 40)
    size, count, names_at = struct.unpack_from("<HHH", data, 58)
    # Name, type, flags, address, offset, size, link, ... of each section of the ELF file.
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + k * size) for k in range(count)]

    def text(base: int, offset: int) -> str:
        return data[base + offset : data.index(b"\0", base + offset)].decode()

    by_name = {text(sections[names_at][4], section[0]): section for section in sections}
    symbols, notes = by_name[".symtab"], by_name[".nv.info"]
    found, at = {}, notes[4]
    while at < notes[4] + notes[5]:
        form, kind, length = struct.unpack_from("<BBH", data, at)
        if (form, kind) == (4, 0x2F):
            symbol, number = struct.unpack_from("<II", data, at + 4)
            (offset,) = struct.unpack_from("<I", data, symbols[4] + 24 * symbol)
            found[_plain(text(sections[symbols[6]][4], offset))] = number
        at += 4 + (length if form == 4 else 0)
    return found


def _plain(name: str) -> str:
    """A kernel's own name."""
    return re.sub(r"^make__locals__|_[0-9a-f]{8}_cuda_kernel_(forward|backward)$", "", name)


# Ampere, Hopper and Blackwell.
@pytest.mark.parametrize(
    "architecture", [90, *(pytest.param(each, marks=pytest.mark.nightly) for each in (80, 100))]
)
@pytest.mark.parametrize("topic", TOPICS)
def test_single_precision_computes_in_single_precision(
    topic: str, architecture: int, tmp_path: Path
) -> None:
    path = compile_topic(topic, "float32", architecture, tmp_path)
    assert f".target sm_{architecture}" in path.read_text("utf-8", errors="replace")
    kernels = read_ptx(path)
    assert {kernel.name for kernel in kernels} >= KERNELS.get(topic, set())
    doubles = {kernel.name: kernel.doubles[:3] for kernel in kernels if kernel.doubles}
    if topic in IN_DOUBLE:
        assert doubles  # the search finds what there is
    else:
        assert doubles == {}
        assert all("f64" not in kernel.virtual_registers for kernel in kernels)


@pytest.mark.parametrize("topic", ["elasticity", "gathering", "stepping"])
def test_double_precision_compiles_and_the_search_sees_it(topic: str, tmp_path: Path) -> None:
    kernels = read_ptx(compile_topic(topic, "float64", 90, tmp_path))
    moving = [kernel for kernel in kernels if kernel.name != "finish_step"]
    assert all(kernel.doubles for kernel in moving)


@pytest.mark.parametrize(("precision", "stated"), [("float32", 56), ("float64", 90)])
def test_registers_of_machine_code_are_about_those_stated(
    precision: str, stated: int, tmp_path: Path
) -> None:
    found = registers(compile_topic("elasticity", precision, 90, tmp_path, is_ptx=False))
    assert found.keys() == {"force_cells"}
    # Another release of the compiler may do a little otherwise; 255 is where memory takes over.
    assert abs(found["force_cells"] - stated) <= 24
