"""`palpate bench steps`: explicit steps of one body, ours beside other simulators and loops.

A step includes supports, weight and damping. Rows have body, precision and peak_memory_mb; the
rate is in million cells x steps per second. Rivals with our law have relative_force_error, over the
largest nodal force, at a random displacement of a tenth of a cell. Ours have real_time_factor
(simulated over spent time, at each element's own stable step), speedup_from_threads and, on the
kidney, real_time_cells: how many cells of this body would run in real time. Smoothed tetrahedra
have times_linear: the time for a second of motion over that of plain ones; another law has
rate_of_stvk: its rate over that of Saint-Venant-Kirchhoff in the same run. With a device ours also
runs on it: bytes_per_cell, which a step moves, counted from the arrays; the gigabytes_per_second
that result; share_of_copy, the fraction of what copies reach there, for a body beyond the caches;
times_two_cores, over our core on two threads; and paper_rate, the most that an H100's memory would
allow (`paper_rate` of `adapters/ours.py`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import numpy as np

from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import SAFETY, Precision
from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.exchange.nodal_arrays import rest_arrays
from palpate.validation.peers.adapters.ours import paper_rate
from palpate.validation.peers.bench import Benchmark, Row, Scene
from palpate.validation.peers.registry import OURS, Tool, tools_for
from palpate.validation.peers.timing import Child, Schedule
from palpate.validation.states import Progress

KIDNEY = 20_000
_box = partial(brick_box, size=(4.0, 1.0, 1.0), ragged=0.15)
# Number of cells (approximate for the kidney) -> body.
SIZES: dict[int, Callable[[], TetMesh]] = {
    6_000: partial(_box, (40, 5, 5)),
    58_080: partial(_box, (80, 11, 11)),
    600_000: partial(_box, (160, 25, 25)),
    KIDNEY: lambda: mesh_surface(shape_kidney(edge_length=5.15e-3)),
}
TISSUE = Material(1e4, 0.45, 1000.0)
MASS_DAMPING = 5.0  # [1/s]
WEIGHT = (0.0, 0.0, -5.0)  # [N/m3]; the box sinks by about 5 % of its length
_KIND = ("element", "precision", "law")
_COMPUTED = ("threads", "precision", "device")
# Bytes that a step moves: a smaller body may stay in a cache, and does not test the memory.
_BEYOND_CACHES = 1e8
# Short timings catch the quiet moments of a busy machine.
SCHEDULE = Schedule(turns=12, seconds=0.2)


def _ours(element: Element, precision: Precision, num_threads: int = 1, **more: str) -> Tool:
    options = {"element": element, "precision": precision.value, "num_threads": num_threads}
    return Tool(OURS, "ours", options={**options, **more})


TOOLS = (
    *(_ours(*one) for one in product(Element, Precision, (1, 2))),
    *(_ours(Element.LINEAR, each, law=Law.NEO_HOOKEAN_STABLE.value) for each in Precision),
    *tools_for("steps"),
)


def make_scene(size: int, _progress: Progress) -> Iterator[Scene]:
    """A body and all data that every tool gets, as plain arrays."""
    mesh = SIZES[size]()
    body = Body(mesh, TISSUE)
    low, high = mesh.points[:, 0].min(), mesh.points[:, 0].max()
    fixed = np.flatnonzero(mesh.points[:, 0] < low + 0.02 * (high - low)).astype(np.int32)
    test = np.random.default_rng(1).uniform(-0.1, 0.1, mesh.points.shape)
    test *= (6.0 * mesh.volume / mesh.num_cells) ** (1.0 / 3.0)
    test[fixed] = 0.0
    force = body.internal_force(test)
    time_step = SAFETY * body.critical_time_step()

    def finish(rows: list[Row], children: list[Child], _earlier: list[Row]) -> None:
        for row, child in zip(rows, children, strict=True):
            if "force" in child.result:
                difference = np.nanmax(np.abs(child.result["force"] - force))
                row["relative_force_error"] = float(difference / np.abs(force).max())
            if row["tool"] != OURS:
                continue
            if "device" in row:
                compare_device(row, rows)
            row["real_time_factor"] = SAFETY * row["critical_time_step"] / row["seconds"]
            if size == KIDNEY:
                # Cost grows as n, the stable step shrinks as n^(-1/3).
                row["real_time_cells"] = round(row["size"] * row["real_time_factor"] ** 0.75)
            alone = next(
                r for r in rows if all(r.get(name) == row.get(name) for name in (*_KIND, "device"))
            )
            if row is not alone:
                row["speedup_from_threads"] = alone["wall_seconds"] / row["wall_seconds"]
            plain = next(r for r in rows if all(r.get(name) == row.get(name) for name in _COMPUTED))
            if row["law"] != Law.SAINT_VENANT_KIRCHHOFF:
                row["rate_of_stvk"] = plain["wall_seconds"] / row["wall_seconds"]
            elif row is not plain:
                row["times_linear"] = plain["real_time_factor"] / row["real_time_factor"]

    yield Scene(
        mesh.num_cells,
        rest_arrays(Problem(mesh, TISSUE, (Support(fixed),), (BodyForce(WEIGHT),)))
        | {"time_step": time_step, "mass_damping": MASS_DAMPING, "test_displacement": test},
        {"body": "kidney" if size == KIDNEY else "box"},
        finish,
    )


def on_device(benchmark: Benchmark, device: str) -> Benchmark:
    """The benchmark with ours also on a device, and with other simulators that Warp runs."""
    more = tuple(_ours(*one, device=device) for one in product(Element, Precision))
    ours = sum(tool.name == OURS for tool in benchmark.tools)
    there = {"device": device.removeprefix("warp:")}
    timed = {tool.name for tool in benchmark.tools} if there["device"] == "cpu" else set()
    rivals = [
        dataclasses.replace(tool, options={**tool.options, **there})
        for tool in tools_for("steps-on-device")
        if tool.name not in timed
    ]
    tools = (*benchmark.tools[:ours], *more, *benchmark.tools[ours:], *rivals)
    return dataclasses.replace(benchmark, tools=tools)


def compare_device(row: Row, rows: list[Row]) -> None:
    """Compare a device's rate with that of its memory, and with two cores."""
    moved = row["bytes_per_cell"] * row["size"] / row["seconds"] / 1e9
    row["gigabytes_per_second"] = moved
    if row["bytes_per_cell"] * row["size"] > _BEYOND_CACHES:
        row["share_of_copy"] = moved / row["copy_gigabytes_per_second"]
    row["paper_rate"] = paper_rate(row["bytes_per_cell"]) / 1e6
    cores = [
        other
        for other in rows
        if other["tool"] == OURS
        and "device" not in other
        and other["threads"] == 2
        and all(other[name] == row[name] for name in _KIND)
    ]
    if cores:
        row["times_two_cores"] = cores[0]["wall_seconds"] / row["wall_seconds"]


def remark(ours: list[Row], _rivals: list[Row]) -> list[str]:
    """What follows from rows of threads, of smoothed cells, of another law and of a device."""
    threads, smoothed, laws, devices = [], [], [], []
    for row in ours:
        if "speedup_from_threads" in row and "times_linear" not in row:
            threads.append(f"{row['threads']} threads {row['speedup_from_threads']:.2f} times one")
        if "times_linear" in row and row["threads"] == 1:
            smoothed.append(
                f"smoothed {row['times_linear']:.2f} times as long for a second of motion"
            )
        if "rate_of_stvk" in row:
            rate = f"{row['rate_of_stvk']:.2f} of the rate in {row['precision']}"
            laws.append(f"{row['law']} at {rate}")
        if "bytes_per_cell" in row:
            fraction = row.get("share_of_copy")
            of_copy = "" if fraction is None else f", {fraction:.0%} of what copies reach there"
            devices.append(
                f"{row['device']}, {row['element']}, {row['precision']}: "
                f"{row['bytes_per_cell']:.0f} bytes per cell and step{of_copy}; on paper an H100's "
                "memory (3.35 TB/s, nothing else in the way) allows "
                f"{row['paper_rate']:.3g} at most"
            )
    parts = [*threads, *smoothed, *laws, *devices]
    if "real_time_cells" in ours[0]:
        parts.append(f"{ours[0]['real_time_cells']} cells in real time on one core")
    return parts


BENCHMARK = Benchmark(
    task="Steps",
    sizes=tuple(SIZES),
    tools=TOOLS,
    schedule=SCHEDULE,
    make_scenes=make_scene,
    measure_work=lambda row: row["size"] / 1e6,
    rate_unit="million cells x steps per second",
    same=("body",),
    table=("body", "device", "element", "law", "bytes_per_cell", "share_of_copy",
           "times_two_cores", "times_linear", "rate_of_stvk", "speedup_from_threads",
           "relative_force_error",
           "real_time_factor", "peak_memory_mb"),
    remark=remark,
)  # fmt: skip
