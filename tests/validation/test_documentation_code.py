"""Code in README and documentation: what is marked runs, the rest is read as what it says it is."""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer

from palpate.validation.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "validation" / "documentation").rglob("*.md"))]
RUN = "<!-- run -->"
# What a page shows without saying that it can be typed.
SHOWN = ("", "text", "{toctree}", "{eval-rst}")


@dataclass(frozen=True)
class Block:
    """A fenced block: where, in which language, and whether it is marked to be run."""

    page: Path
    line: int
    kind: str
    text: str
    is_run: bool

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks() -> list[Block]:
    """Of all pages."""
    found = []
    for page in PAGES:
        lines, start, mark = page.read_text("utf-8").splitlines(), None, False
        for number, line in enumerate(lines):
            if start is None and line.startswith("```"):
                start, mark = number, number > 0 and lines[number - 1].strip() == RUN
            elif start is not None and line == "```":
                text = "\n".join(lines[start + 1 : number])
                found.append(Block(page, start + 1, lines[start][3:].strip(), text, mark))
                start = None
        assert start is None, f"{page}: a block that begins in line {start} has no end"
    return found


BLOCKS = blocks()


def palpate_commands(text: str) -> list[list[str]]:
    """Words of each `palpate ...` of a shell block, behind what may stand before it."""
    joined = text.replace("\\\n", " ")
    found = []
    for line in joined.splitlines():
        words = shlex.split(line, comments=True)
        while words and (words[0] in ("mpirun", "-n") or "=" in words[0] or words[0].isdigit()):
            words = words[1:]
        if words[:1] == ["palpate"]:
            found.append(words[1:])
    return found


def wrong_words(words: list[str]) -> list[str]:
    """The command or options of a call that palpate does not have."""
    command = typer.main.get_command(app)
    while words and hasattr(command, "commands") and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    if hasattr(command, "commands") and words and not words[0].startswith("-"):
        return [words[0]]
    known = {name for one in command.params for name in (*one.opts, *one.secondary_opts)}
    options = [word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    return [option for option in options if option not in known | {"--help"}]


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.kind not in SHOWN], ids=str)
def test_a_block_is_what_it_says_it_is(block: Block) -> None:
    if block.kind == "sh":
        read = subprocess.run(
            ["bash", "-n"], input=block.text, text=True, capture_output=True, check=False
        )
        assert read.returncode == 0, read.stderr
        wrong = [(words, wrong_words(words)) for words in palpate_commands(block.text)]
        assert [pair for pair in wrong if pair[1]] == []
    elif block.kind == "python":
        ast.parse(block.text)
    elif block.kind == "toml":
        tomllib.loads(block.text)
    elif block.kind == "json":
        json.loads(block.text)
    elif block.kind == "yaml":
        yaml = pytest.importorskip("yaml")
        assert isinstance(yaml.safe_load(block.text), dict)
    else:
        pytest.fail(f"{block}: nobody checks a block of {block.kind!r}")


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.is_run], ids=str)
def test_a_marked_block_runs(block: Block, tmp_path: Path) -> None:
    shim = tmp_path / "bin" / "palpate"
    shim.parent.mkdir()
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m palpate.validation.cli "$@"\n', "utf-8")
    shim.chmod(0o755)
    command = {"sh": ["bash", "-euo", "pipefail", "-c"], "python": [sys.executable, "-c"]}
    environment = {**os.environ, "PATH": f"{shim.parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        [*command[block.kind], block.text],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_there_is_something_to_run_and_a_wrong_option_is_seen() -> None:
    assert sum(block.is_run for block in BLOCKS) >= 4
    assert wrong_words(["gate", "kidney", "--elemnt", "both"]) == ["--elemnt"]
    assert wrong_words(["gat", "kidney"]) == ["gat"]
    assert wrong_words(["gate", "kidney", "--element", "both", "--expected"]) == []
