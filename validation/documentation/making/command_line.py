"""The command line: every command with its options, and what its exit code means."""

from __future__ import annotations

import re

import typer
from typer.cli import get_docs_for_click

from making.tables import table
from palpate.validation.cli import app
from palpate.validation.states import ExitCode


def exit_codes() -> str:
    """The exit codes, the same for every command."""
    rows = [(str(int(code)), code.meaning) for code in ExitCode]
    return (
        "# Exit codes\n\nThe same for every command. With several cases the gravest decides, in "
        "the order 4, 2, 1, 3, 0. A signal ends a command with 128 and its number.\n\n"
        + table(("code", "meaning"), rows)
    )


def commands() -> str:
    """Every command with its options, as Typer writes them."""
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="palpate")
    text = get_docs_for_click(obj=command, ctx=context, name="palpate", title="Commands")
    # Lists of --help, marked by \b, stay lists.
    text = re.sub(r"\x08\n(.+:)\n((?:  .+\n)+)", r"\1\n\n```text\n\2```\n", text)
    return text.replace("<bool>", "").strip() + "\n"
