"""Fenced blocks of a Markdown page, and what a mark above one asks for.

`<!-- run -->` runs a block, in one fresh folder for each page and in the page's order;
`<!-- run: 1 -->` expects that exit code; `quietly` leaves out what it printed; `nightly` is for
takes long or needs FEniCSx. `<!-- file NAME -->` writes a block there, for the blocks below it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

_MARK = re.compile(r"<!-- (?:run(?:: (?P<code>\d))?(?P<how>(?: \w+)*)|file (?P<file>[\w.-]+)) -->")


@dataclass(frozen=True)
class Block:
    """A fenced block from line to `last`, from 1, in the language `kind`, and what its mark asks.

    It ends with the exit `code`; `file` is where it is written, for the blocks below.
    """

    line: int
    last: int
    kind: str
    text: str
    is_run: bool = False
    code: int = 0
    is_quiet: bool = False
    is_nightly: bool = False
    file: str = ""


def blocks_of(page: str) -> Iterator[Block]:
    """Of a page, from top to bottom; ValueError for one without an end, or an unknown mark."""
    start: int | None = None
    lines = page.splitlines()
    for number, line in enumerate(lines, start=1):
        if start is None and line.startswith("```"):
            start = number
        elif start is not None and line == "```":
            above = lines[start - 2].strip() if start > 1 else ""
            text = "\n".join(lines[start : number - 1])
            yield _marked(above, start, number, lines[start - 1][3:].strip(), text)
            start = None
    if start is not None:
        raise ValueError(f"the block that begins in line {start} has no end")


def _marked(above: str, line: int, last: int, kind: str, text: str) -> Block:
    if not above.startswith("<!--"):
        return Block(line, last, kind, text)
    mark = _MARK.fullmatch(above)
    how = set((mark["how"] or "").split()) if mark else {"?"}
    if mark is None or how - {"quietly", "nightly"}:
        raise ValueError(f"line {line - 1}: what does {above!r} ask for?")
    return Block(
        line, last, kind, text,
        is_run=mark["file"] is None, code=int(mark["code"] or 0),
        is_quiet="quietly" in how, is_nightly="nightly" in how, file=mark["file"] or "",
    )  # fmt: skip


# Runs the marked blocks of a page, and puts below each what it printed.

_WITH = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
# Characters in a line of what a command prints.
WIDTH = 92


class BlockFailedError(Exception):
    """A marked block did not end as its mark says; the message has what it printed."""


def with_outputs(name: str, page: str) -> str:
    """The page, each of its marked blocks run and followed by what it printed; see `run_blocks`."""
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
        page_folder = Path(folder) / "page"
        page_folder.mkdir()
        for block in blocks:
            if block.file:
                (page_folder / block.file).write_text(block.text + "\n", encoding="utf-8")
            if not block.is_run:
                continue
            done = subprocess.run(
                [*_WITH[block.kind], block.text],
                cwd=page_folder, env=environment, capture_output=True, text=True, check=False,
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
