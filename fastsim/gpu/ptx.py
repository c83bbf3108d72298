"""What the kernels become on a GPU, found without one: PTX, its doubles and its registers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from palpate.fastsim.gpu.devices import WARP_CPU, load_warp
from palpate.fastsim.gpu.kernels.kit import TOPICS
from palpate.fastsim.gpu.launches import kernels_of

# Ampere, Hopper and Blackwell.
ARCHITECTURES = (80, 90, 100)
_ENTRY = re.compile(r"\.entry\s+(\w+)\s*\(")
_REGISTERS = re.compile(r"\.reg\s+\.(b16|b32|b64|f32|f64)\s+%\w+<(\d+)>")
_DOUBLE = re.compile(r"^\s*(?:@\S+\s+)?[a-z]\S*\.f64\S*\s.*$", re.MULTILINE)


@dataclass(frozen=True)
class KernelPtx:
    """A kernel as compiled for an architecture.

    Attributes:
        name: As in `kernels/`.
        doubles: Instructions on numbers of double precision.
        virtual_registers: By kind ("f32", "f64", "b32", ...), as PTX declares them. These are the
            compiler's names for values, each written once; the driver's assembler maps them onto
            the at most 255 registers of 32 bits that a thread has. So they bound nothing from
            below, and say which kinds of numbers a kernel computes with.
    """

    name: str
    doubles: tuple[str, ...]
    virtual_registers: dict[str, int]


def compile_ptx(topic: str, precision: str, architecture: int, folder: Path) -> Path:
    """The PTX file of a topic's kernels, compiled into a folder; needs no GPU.

    Args:
        topic: One of `kernels.kit.TOPICS`.
        precision: "float32" or "float64".
        architecture: 80, 90 or 100, ...
        folder: Made where it is not there.

    Raises:
        DeviceUnavailableError: Warp is not installed.
    """
    if topic not in TOPICS:
        raise KeyError(topic)
    wp = load_warp(WARP_CPU)
    module = kernels_of(wp, precision).modules[topic]
    folder.mkdir(parents=True, exist_ok=True)
    paths = wp.compile_aot_module(module, arch=architecture, module_dir=folder, use_ptx=True)
    return next(Path(path) for path in paths if str(path).endswith(".ptx"))


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
        name = re.sub(r"^make__locals__|_[0-9a-f]{8}_cuda_kernel_(forward|backward)$", "",
                      begin.group(1))  # fmt: skip
        doubles = tuple(line.strip() for line in _DOUBLE.findall(body))
        found.append(KernelPtx(name, doubles, counts))
    return found
