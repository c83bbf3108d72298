"""One version number, wherever it is written."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import palpate
from palpate.fastsim import _core

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
VERSION = PROJECT["version"]


def test_citation_changelog_recipe_and_example_name_the_version_of_the_package() -> None:
    citation = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.M)
    assert citation is not None
    assert citation[1] == VERSION
    recipe = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text("utf-8")
    assert f'version: "{VERSION}"' in recipe
    workflow = ROOT / "validation/examples/gate_your_simulator/.github/workflows/palpate.yml"
    assert f"/palpate-{VERSION}-" in workflow.read_text("utf-8")
    titles = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    # What is not released yet comes first; the newest that is bears the number.
    assert titles[0] in ("Unreleased", VERSION)
    assert [title for title in titles if title != "Unreleased"][:1] in ([], [VERSION])


def test_no_version_of_the_changelog_says_a_thing_twice() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    for section in re.split(r"^## ", text, flags=re.M)[1:]:
        lines = [line for line in section.splitlines() if line.startswith(("### ", "- "))]
        twice = {line for line in lines if lines.count(line) > 1}
        assert not twice, f"twice under {section.splitlines()[0]}: {sorted(twice)}"


def test_the_recipe_for_conda_asks_for_what_the_package_asks_for() -> None:
    text = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text("utf-8")
    run = re.findall(r"^    - (.+)$", text[text.index("  run:") : text.index("  run_con")], re.M)
    wanted = {line.replace(">=", " >=") for line in PROJECT["dependencies"]}
    wanted = {line.replace("matplotlib ", "matplotlib-base ") for line in wanted}
    assert set(run) == wanted | {"python " + PROJECT["requires-python"]}


def test_the_package_and_its_core_are_of_one_build() -> None:
    assert palpate.__version__ == _core.__version__


@pytest.mark.skipif(palpate.__version__ == "dev", reason="the sources in place are of no build")
def test_an_installed_package_has_the_version_of_its_sources() -> None:
    assert metadata.version("palpate") == palpate.__version__ == VERSION
