"""Runs a benchmark by name: its rows, the machine they were timed on, rivals left out."""

from __future__ import annotations

import importlib
import json
import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from palpate.meshes.errors import InputError

Row = dict[str, Any]
# Columns that every row has, in the order of the table.
COMMON = ("tool", "size", "threads", "precision", "seconds", "rate")


class Benchmark(Protocol):
    """A function that times ours beside rivals and returns a row for each timing."""

    def __call__(
        self, *, sizes: Sequence[int] = ..., progress: Callable[[str], None] | None = None
    ) -> list[Row]:
        """Time the given sizes (default: all of the benchmark's own)."""


# Name on the command line -> module and function. A module may have RIVALS, tool -> how to
# install it: those without a row are named as left out; TABLE, the columns worth a place on the
# terminal; and `summarise(rows)`, what the rows say in a few lines.
BENCHMARKS = {
    "steps": ("steps", "bench_steps"),
    "static": ("static", "bench_static"),
    "delaunay": ("delaunay", "bench_delaunay"),
    "mesh": ("mesh", "bench_mesh"),
    "collision": ("collision", "bench_collision"),
}


def run_benchmark(
    name: str,
    *,
    sizes: Sequence[int] | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Time a benchmark.

    Args:
        name: A key of `BENCHMARKS`.
        sizes: Problem sizes, of those the benchmark has; None times them all.
        progress: Called with one line per row.

    Returns:
        The document of `palpate bench --json`: bench, machine, rows, left_out, which says of
        every rival without a row how it is installed, summary, lines of text, and table, the
        columns to show beside the common ones (all, where it is empty).

    Raises:
        InputError: No such benchmark, or it does not have such a size.
    """
    if name not in BENCHMARKS:
        raise InputError(f"no benchmark {name!r}; there are {', '.join(BENCHMARKS)}")
    module_name, function_name = BENCHMARKS[name]
    module = importlib.import_module(f"palpate.validation.benchmarks.{module_name}")
    function: Benchmark = getattr(module, function_name)
    if sizes:
        known: Sequence[int] = tuple(getattr(module, "SIZES", sizes))
        if unknown := [size for size in sizes if size not in known]:
            raise InputError(
                f"benchmark {name} has no size {unknown[0]}; it has {', '.join(map(str, known))}"
            )
        rows = function(sizes=tuple(sizes), progress=progress)
    else:
        rows = function(progress=progress)
    timed = {row["tool"] for row in rows}
    rivals: dict[str, str] = getattr(module, "RIVALS", {})
    left_out = {tool: how for tool, how in rivals.items() if tool not in timed}
    summarise: Callable[[list[Row]], list[str]] = getattr(module, "summarise", _say_nothing)
    return {
        "bench": name,
        "machine": describe_machine(),
        "rows": rows,
        "left_out": left_out,
        "summary": summarise(rows),
        "table": list(getattr(module, "TABLE", ())),
    }


def _say_nothing(_rows: list[Row]) -> list[str]:
    return []


def bench_json(document: dict[str, Any]) -> str:
    """The document as strict JSON."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def describe_machine() -> dict[str, Any]:
    """What the timings depend on: processor, cores, memory, load, system."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_mb": round(_memory_mb()),
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _memory_mb() -> float:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**20
    except (AttributeError, ValueError, OSError):
        return 0.0
