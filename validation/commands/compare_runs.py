"""`palpate compare-runs`: two results.json side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text


def compare_runs(
    first: Annotated[Path, typer.Argument(help="results.json of a run")],
    second: Annotated[Path, typer.Argument(help="of another")],
    summary: Annotated[Path | None, typer.Option(help="the table as Markdown")] = None,
) -> None:
    """Put two runs, or two versions, side by side; 1 where a verdict of the second is worse."""
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.validation.judging import run_comparison
    from palpate.validation.output_files import require_outputs
    from palpate.validation.quoting import for_terminal

    require_outputs({"--summary": summary}, inputs=[first, second])
    compared = run_comparison.compare_runs(first, second)
    names = (str(first), str(second))
    table = Table()
    for title in ("case", "check", *names, "change"):
        table.add_column(Text(for_terminal(title)), overflow="fold")
    for pair in compared.changed:
        style = "red" if pair.is_worse else "green" if pair.change == "better" else ""
        table.add_row(*(Text(for_terminal(cell), style=style) for cell in pair.cells))
    console = Console(highlight=False)
    if table.row_count:
        console.print(table)
    for remark in compared.remarks:
        console.print(Text(for_terminal(remark)))
    if summary is not None:
        write_text_atomically(summary, compared.markdown(*names))
    raise typer.Exit(compared.exit_code)
