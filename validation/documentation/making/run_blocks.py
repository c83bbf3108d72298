"""Runs the marked blocks of a page, and puts below each what it printed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from making.blocks import Block, blocks_of

_WITH = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
# Characters in a line of what a command prints.
WIDTH = 92


class BlockFailedError(Exception):
    """A marked block did not end as its mark says; the message has what it printed."""


def with_outputs(name: str, page: str) -> str:
    """The page, each of its marked blocks run and followed by what it printed.

    Raises:
        BlockFailedError: One of them ended otherwise than its mark says.
    """
    blocks = list(blocks_of(page))
    printed = run_blocks(name, [block for block in blocks if not block.is_nightly])
    lines = page.splitlines()
    for block in reversed(blocks):
        if block.line in printed and not block.is_quiet:
            shown = ["", "```{code-block} text", ":class: output", *printed[block.line], "```"]
            lines[block.last : block.last] = shown
    return "\n".join(lines) + "\n"


def run_blocks(name: str, blocks: Iterable[Block]) -> dict[int, list[str]]:
    """Run the marked ones of them in one fresh folder; by its line, the lines that each printed.

    Progress and warnings are left out where there is something else.

    Raises:
        BlockFailedError: One of them ended otherwise than its mark says.
    """
    printed = {}
    with tempfile.TemporaryDirectory() as folder:
        environment = _with_palpate(Path(folder))
        place = Path(folder) / "page"
        place.mkdir()
        for block in blocks:
            if block.file:
                (place / block.file).write_text(block.text + "\n", encoding="utf-8")
            if not block.is_run:
                continue
            done = subprocess.run(
                [*_WITH[block.kind], block.text],
                cwd=place, env=environment, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode != block.code:
                raise BlockFailedError(
                    f"{name}:{block.line} ended with {done.returncode}, not with {block.code}\n"
                    f"{block.text}\n{done.stdout}{done.stderr}"
                )
            text = done.stdout.strip("\n") or done.stderr.strip("\n")
            printed[block.line] = [line.rstrip() for line in text.splitlines()]
    return printed


def _with_palpate(folder: Path) -> dict[str, str]:
    """An environment in which `palpate` and `python` are the ones that run this."""
    tools = folder / "bin"
    tools.mkdir()
    for name, words in {"palpate": " -m palpate.validation.cli", "python": ""}.items():
        (tools / name).write_text(f'#!/bin/sh\nexec "{sys.executable}"{words} "$@"\n', "utf-8")
        (tools / name).chmod(0o755)
    path = f"{tools}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "COLUMNS": str(WIDTH), "OMP_NUM_THREADS": "1"}
