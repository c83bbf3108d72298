"""Fenced blocks of a Markdown page, and what a mark above one asks for.

`<!-- run -->` runs a block, in one fresh folder for each page and in the page's order;
`<!-- run: 1 -->` expects that exit code; `quietly` leaves out what it printed; `nightly` is for
takes long or needs FEniCSx. `<!-- file NAME -->` writes a block there, for the blocks below it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_MARK = re.compile(r"<!-- (?:run(?:: (?P<code>\d))?(?P<how>(?: \w+)*)|file (?P<file>[\w.-]+)) -->")


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        line: Of its opening fence, from 1.
        last: Of its closing fence.
        kind: The language that it names.
        text: Of it.
        is_run: Whether it is marked to be run.
        code: The exit code that it ends with.
        is_quiet: Whether what it prints is left out.
        is_nightly: Whether it is run at night only.
        file: Where it is written, for the blocks below; empty where it is not.
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
    """Of a page, from top to bottom.

    Raises:
        ValueError: A block without an end, or a mark that nobody knows.
    """
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
