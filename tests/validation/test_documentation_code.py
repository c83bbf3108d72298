"""Code in README and documentation: what is marked runs, the rest is read as what it says it is."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest
import typer
from making.blocks import Block, BlockFailedError, blocks_of, run_blocks, with_outputs

from palpate.validation.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "validation" / "documentation").rglob("*.md"))]
# What a page shows without saying that it can be typed.
SHOWN = ("", "text", "{toctree}", "{eval-rst}")
BLOCKS = [(page, block) for page in PAGES for block in blocks_of(page.read_text("utf-8"))]


def name_of(page: Path) -> str:
    """Of a page, or of a block in it."""
    return str(page.relative_to(ROOT))


def ids(blocks: list[tuple[Path, Block]]) -> list[str]:
    """Where each stands."""
    return [f"{name_of(page)}:{block.line}" for page, block in blocks]


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


CHECKED = [(page, block) for page, block in BLOCKS if block.kind not in SHOWN]


@pytest.mark.parametrize(("page", "block"), CHECKED, ids=ids(CHECKED))
def test_a_block_is_what_it_says_it_is(page: Path, block: Block) -> None:
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
        pytest.fail(f"{page}:{block.line}: nobody checks a block of {block.kind!r}")


def test_what_the_readme_marks_runs() -> None:
    """What the pages mark is run by `make docs`, in the same way."""
    readme = PAGES[0]
    blocks = [block for page, block in BLOCKS if page == readme]
    assert any(block.is_run for block in blocks)
    run_blocks(readme.name, blocks)


NIGHTLY = sorted({page for page, block in BLOCKS if block.is_nightly})


@pytest.mark.nightly
@pytest.mark.dolfinx
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", NIGHTLY, ids=map(name_of, NIGHTLY))
def test_what_takes_long_on_a_page_runs(page: Path) -> None:
    run_blocks(name_of(page), [block for of_page, block in BLOCKS if of_page == page])


def test_a_wrong_option_is_seen() -> None:
    assert wrong_words(["gate", "kidney", "--elemnt", "both"]) == ["--elemnt"]
    assert wrong_words(["gat", "kidney"]) == ["gat"]
    assert wrong_words(["gate", "kidney", "--element", "both", "--expected"]) == []


PAGE = """# A page
<!-- file two.py -->
```python
print(2)
```

<!-- run -->
```sh
python two.py; touch here
```

Then, in the same folder:

<!-- run: 3 -->
```sh
test -e here && exit 3
```

<!-- run quietly -->
```sh
echo quiet
```
"""


def test_a_page_is_run_in_one_folder_and_shows_what_was_printed() -> None:
    lines = with_outputs("page", PAGE).splitlines()
    assert lines[lines.index(":class: output") + 1 :][:2] == ["2", "```"]
    assert sum(line == ":class: output" for line in lines) == 2
    assert "quiet" not in lines


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("exit 3", "exit 0", "page:15 ended with 0, not with 3"),
        ("python two.py", "python three.py", "page:8 ended with 2, not with 0"),
    ],
)
def test_a_block_that_ends_otherwise_ends_the_making(old: str, new: str, said: str) -> None:
    with pytest.raises(BlockFailedError, match=re.escape(said)):
        with_outputs("page", PAGE.replace(old, new))


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ("<!-- rnu -->\n```sh\ntrue\n```", "what does '<!-- rnu -->' ask for?"),
        ("<!-- run loudly -->\n```sh\ntrue\n```", "what does '<!-- run loudly -->' ask for?"),
        ("```sh\ntrue\n", "has no end"),
    ],
)
def test_a_mark_that_nobody_knows_is_refused(page: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        list(blocks_of(page))
