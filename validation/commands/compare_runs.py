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
    from palpate.validation.judging.two_runs import (
        exit_code_of,
        pair_runs,
        pairs_markdown,
        shown,
    )
    from palpate.validation.output_files import require_outputs
    from palpate.validation.quoting import for_terminal

    require_outputs({"--summary": summary}, inputs=[first, second])
    pairs = pair_runs(first, second)
    names = [str(first), str(second)]
    table = Table()
    for title in ("case", "check", *names, "change"):
        table.add_column(Text(for_terminal(title)), overflow="fold")
    for pair in pairs:
        style = "red" if pair.is_worse else "green" if pair.change == "better" else ""
        cells = (pair.case, pair.check, shown(pair.first), shown(pair.second), pair.change)
        if pair.change != "same":
            table.add_row(*(Text(for_terminal(cell), style=style) for cell in cells))
    console = Console(highlight=False)
    if table.row_count:
        console.print(table)
    text = pairs_markdown(pairs, *names)
    remarks = [line for line in text.splitlines() if line and not line.startswith("|")]
    console.print(Text(for_terminal("\n".join(remarks))))
    if summary is not None:
        write_text_atomically(summary, text)
    raise typer.Exit(exit_code_of(pairs))
