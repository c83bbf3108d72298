"""Runs a benchmark by name: its rows, their summary, the machine, and rivals left out."""

from __future__ import annotations

import importlib
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from palpate.fastsim.gpu.devices import CORE, check_device
from palpate.meshes.errors import InputError
from palpate.validation.peers.registry import OURS, Tool
from palpate.validation.peers.timing import Child, Schedule, timed
from palpate.validation.quoting import texts_for_json
from palpate.validation.states import Progress, in_silence
from palpate.validation.versions import version_of

Row = dict[str, Any]
# The columns of every row, in the order of the table.
COMMON = ("tool", "size", "threads", "precision", "seconds", "rate")


@dataclass(frozen=True, eq=False)
class Scene:
    """A task that all tools do beside each other: size, arrays for adapters, further columns.

    `finish(rows, children, earlier)` adds columns that follow from the results, from the rows of
    all tools and from those of earlier scenes.
    """

    size: int
    job: Mapping[str, Any]
    columns: Mapping[str, Any]
    finish: Callable[[list[Row], list[Child], list[Row]], None]


@dataclass(frozen=True)
class Benchmark:
    """A comparison of tools at a `task`, the name of the class in the adapters.

    `make_scenes` makes the scenes of a size; `measure_work` of one step in `rate_unit` over seconds
    is the rate. Rows must agree in the columns `same` to be compared; `table` are columns shown on
    the terminal beside `COMMON`, all where it is empty. `remark` adds to the rates of the summary,
    from our rows that agree in `same`, and from those of the rivals, the quickest first.
    """

    task: str
    sizes: Sequence[int]
    tools: Sequence[Tool]
    schedule: Schedule
    make_scenes: Callable[[int, Progress], Iterator[Scene]]
    measure_work: Callable[[Row], float]
    rate_unit: str
    same: tuple[str, ...] = ()
    table: tuple[str, ...] = ()
    remark: Callable[[list[Row], list[Row]], list[str]] = lambda _ours, _rivals: []


# Names on the command line, and modules, each with a `BENCHMARK`. One of palpate alone (the live
# page's server under a client, the condensed model under a ball) has sizes and table as well,
# measure(size, progress), its rows, and summary(rows), lines.
_HERE = "palpate.validation.peers.bench"
MODULES = {
    name: f"{_HERE}_{name}"
    for name in ("steps", "static", "truth", "delaunay", "mesh", "collision")
} | {"touch": "palpate.validation.live.bench_touch", "condensed": f"{_HERE}_condensed"}


def run_benchmark(
    name: str,
    *,
    sizes: Sequence[int] | None = None,
    device: str = "cpu",
    progress: Progress = in_silence,
) -> dict[str, Any]:
    """Time a benchmark of `MODULES` at its sizes, or some of them, on a device as well.

    Returns:
        The document of `palpate bench --json`: bench, machine, rows, left_out, which states for
        every rival without a row how it is installed, summary, lines of text, and table, the
        columns to show beside the common ones (all, where it is empty).

    Raises:
        InputError: There is no such benchmark, or it has no such size or runs on no device.
    """
    if name not in MODULES:
        raise InputError(f"no benchmark {name!r}; there are {', '.join(MODULES)}")
    module = importlib.import_module(MODULES[name])
    benchmark: Benchmark | SimpleNamespace = module.BENCHMARK
    if check_device(device) != CORE:
        if not hasattr(module, "on_device"):
            raise InputError(f"benchmark {name} runs on no device; --device goes with steps")
        benchmark = module.on_device(benchmark, device)
    if unknown := [size for size in sizes or () if size not in benchmark.sizes]:
        there = ", ".join(map(str, benchmark.sizes))
        raise InputError(f"benchmark {name} has no size {unknown[0]}; it has {there}")
    chosen = sizes or benchmark.sizes
    rivals: dict[str, str] = {}
    if isinstance(benchmark, Benchmark):
        rows = time_all(benchmark, chosen, progress)
        summary = summarise(benchmark, rows)
        rivals = {tool.name: tool.install for tool in benchmark.tools if tool.name != OURS}
    else:
        rows = [row for size in chosen for row in benchmark.measure(size, progress)]
        summary = benchmark.summary(rows)
    timed_tools = {row["tool"] for row in rows}
    return {
        "bench": name,
        "machine": describe_machine(),
        "rows": rows,
        "left_out": {tool: how for tool, how in rivals.items() if tool not in timed_tools},
        "summary": summary,
        "table": list(benchmark.table),
    }


def time_all(benchmark: Benchmark, sizes: Sequence[int], progress: Progress) -> list[Row]:
    """Rows of all scenes of some sizes; tools that fail or do not fit go to `progress`."""
    rows: list[Row] = []
    for size in sizes:
        for scene in benchmark.make_scenes(size, progress):
            task, schedule = benchmark.task, benchmark.schedule
            with timed(benchmark.tools, task, scene.job, schedule, progress) as children:
                found = [_row(child, scene) for child in children]
                scene.finish(found, children, rows)
            for row in found:
                row["rate"] = benchmark.measure_work(row) / row["seconds"]
                row["rate_unit"] = benchmark.rate_unit
                same = ", ".join(str(row[column]) for column in ("size", *benchmark.same))
                progress(
                    f"{row['tool']:22} {same:40} {row['precision']}  {row['threads']} thread(s)"
                    f"  {row['seconds']:9.3g} s  {row['rate']:8.3g} {row['rate_unit']}"
                )
            rows += found
    return rows


def _row(child: Child, scene: Scene) -> Row:
    """The row of a tool: processor time on one thread, wall time on several and on a GPU."""
    clocks = {clock: child.best(clock) for clock in ("processor", "wall")}
    threads = int(child.tool.options.get("num_threads", 1))
    # Processor time does not include what a GPU does.
    is_gpu = str(child.tool.options.get("device", CORE)).startswith("cuda")
    return {
        "tool": child.tool.name,
        "version": child.version,
        "size": scene.size,
        "threads": threads,
        "precision": child.precision,
        **scene.columns,
        **{name: value for name, value in child.timings[-1].items() if name not in clocks},
        "seconds": clocks["wall" if threads > 1 or is_gpu else "processor"],
        "wall_seconds": clocks["wall"],
    }


def summarise(benchmark: Benchmark, rows: Sequence[Row]) -> list[str]:
    """Our rate over each rival's, the quickest first, for rows that are comparable."""
    lines = []
    columns = ("size", *benchmark.same)
    for key in dict.fromkeys(tuple(row[column] for column in columns) for row in rows):
        here = [row for row in rows if tuple(row[column] for column in columns) == key]
        rivals = sorted((r for r in here if r["tool"] != OURS), key=lambda row: row["seconds"])
        everything = [row for row in here if row["tool"] == OURS]
        for precision in dict.fromkeys(row["precision"] for row in everything):
            ours = [row for row in everything if row["precision"] == precision]
            parts = [
                f"{row['seconds'] / ours[0]['seconds']:.1f} times {row['tool']} {row['version']}"
                + ("" if row["precision"] == precision else f" in {row['precision']}")
                for row in rivals
            ]
            parts += benchmark.remark(ours, rivals)
            lines.append(f"{', '.join(map(str, key))}, {precision}: " + ", ".join(parts))
    return lines


def bench_json(document: dict[str, Any]) -> str:
    """The document of a benchmark as strict JSON."""
    own = texts_for_json({"palpate": version_of("palpate"), **document})
    return json.dumps(own, indent=2, allow_nan=False) + "\n"


def describe_machine() -> dict[str, Any]:
    """What the timings depend on: processor, cores, memory, load, system."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        **_memory_and_load(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def _memory_and_load() -> dict[str, float]:
    """Memory and load as far as the system reports them; Windows reports neither in this way."""
    found: dict[str, float] = {}
    if hasattr(os, "sysconf"):
        pages = os.sysconf("SC_PHYS_PAGES")
        found["memory_mb"] = round(os.sysconf("SC_PAGE_SIZE") * pages / 2**20)
    if hasattr(os, "getloadavg"):
        found["load_average"] = round(os.getloadavg()[0], 2)
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
