"""Every verb of the command line, with the command that it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer

from palpate.validation.cli import app


def verbs(group: Any = None, before: str = "") -> Iterator[tuple[str, Any]]:
    """Verbs such as "gate" and "reference build", in the order of --help."""
    group = group or typer.main.get_command(app)
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from verbs(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command
