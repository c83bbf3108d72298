"""`palpate bench NAME`: the table on the terminal, and the same as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

# Told once, under the table.
_TOLD_ONCE = ("version", "rate_unit")


def bench(
    name: Annotated[
        str,
        typer.Argument(help="steps, static, truth, delaunay, mesh, collision, touch or condensed"),
    ],
    json: Annotated[Path | None, typer.Option(help="file for the rows")] = None,
    size: Annotated[list[int] | None, typer.Option(help="only this size; repeatable")] = None,
    device: Annotated[
        str, typer.Option(help="of steps: ours on cuda:0 or warp:cpu as well, beside its core")
    ] = "cpu",
) -> None:
    """Time palpate beside the rivals that are installed, in one run.

    PALPATE_BENCH_PYTHON names more interpreters, separated like PATH, whose rivals are timed too.
    """
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.validation.output_files import require_outputs
    from palpate.validation.peers.bench import bench_json, run_benchmark

    require_outputs({"--json": json})
    console = Console(stderr=True, highlight=False, markup=False)
    document = run_benchmark(
        name,
        sizes=size,
        device=device,
        progress=lambda line: console.print(f"  {line}", style="dim", soft_wrap=True),
    )
    if json is not None:
        write_text_atomically(json, bench_json(document))
    out = Console(highlight=False)
    # A file or a pipe has no width of its own; 80 columns would cut every number short.
    print_bench(document, out if out.is_terminal else Console(highlight=False, width=200))


def print_bench(document: dict[str, Any], console: Console) -> None:
    """Print the rows, and one line each for versions, machine and rivals left out."""
    from palpate.validation.peers.bench import COMMON

    rows = document["rows"]
    present = dict.fromkeys(key for row in rows for key in row)
    wanted = document.get("table") or [key for key in present if key not in _TOLD_ONCE]
    columns = [*COMMON, *(key for key in wanted if key in present and key not in COMMON)]
    if len({(row["tool"], row.get("version")) for row in rows}) > len({r["tool"] for r in rows}):
        columns.insert(1, "version")  # some tool is there twice
    table = Table(title=f"bench {document['bench']}", title_justify="left")
    for column in columns:
        is_text = any(isinstance(row.get(column), str) for row in rows)
        table.add_column(column, justify="left" if is_text else "right")
    for row in rows:
        table.add_row(*(_shown(column, row.get(column)) for column in columns))
    console.print(table)
    for line in document.get("summary", ()):
        console.print(line, markup=False, soft_wrap=True)
    versions = sorted({f"{row['tool']} {row['version']}" for row in rows if row.get("version")})
    for line in (
        "rate: " + ", ".join(sorted({row["rate_unit"] for row in rows})),
        "versions: " + ", ".join(versions),
        "machine: " + ", ".join(f"{k} {v}" for k, v in document["machine"].items()),
        *(f"left out: {tool}, {how}" for tool, how in document["left_out"].items()),
    ):
        console.print(line, markup=False, soft_wrap=True)


def _shown(column: str, value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.7g}" if column.endswith("displacement") else f"{value:.4g}"
    return str(value)
