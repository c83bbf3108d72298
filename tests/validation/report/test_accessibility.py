"""What a reader without a mouse, with a small screen or weak eyes meets: axe finds nothing grave.

Reports and the scoreboard always, on light and dark ground; the documentation too where
PALPATE_DOCS says where it was built.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.problem import Element
from palpate.validation.cached_results import ResultCache
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.peers.board import compute_board
from palpate.validation.peers.board_page import write_board
from palpate.validation.peers.registry import Peer
from palpate.validation.report import html
from palpate.validation.states import in_silence

pytestmark = pytest.mark.browser
GRAVE = ("serious", "critical")
# A phone, a desk.
WIDTHS = (390, 1400)
SCHEMES = ("light", "dark")
# One of each kind: with outputs, formulas, a drawing, sources folded, tables, an executed example.
DOCS = (
    "index", "start", "theory/explicit_step", "architecture", "made/equations", "made/cases",
    "made/cases/kidney", "made/keys", "made/commands", "made/judge_my_simulator", "made/changelog",
    "api", "genindex", "search",
)  # fmt: skip


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A failed case with both elements, one that passed, and their index."""
    folder = tmp_path_factory.mktemp("pages")
    candidates = [fastsim_candidate(element=element) for element in Element]
    failed = judge_case(load_case("block-fine"), candidate=candidates)
    passed = dataclasses.replace(judge_case(load_case("block")), name="block")
    html.write_report([failed, passed], folder)
    return [folder / name for name in ("block-fine.html", "block.html", "index.html")]


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A scoreboard of simulators that report no motion, crash and refuse, on a case."""
    folder = tmp_path_factory.mktemp("board")
    still = folder / "still.py"
    still.write_text(
        "import json, sys, numpy as np; from pathlib import Path\n"
        "points = np.load(Path(sys.argv[1], 'rest.npz'))['points']\n"
        "key = json.loads(Path(sys.argv[1], 'case.json').read_text('utf-8'))['case_key']\n"
        "np.savez(sys.argv[2], displacement=0.0 * points, case_key=key)\n",
        "utf-8",
    )
    commands = {
        "still": f"{sys.executable} {still} {{case}} {{result}}",
        "crashes": f"{sys.executable} -c 1/0 {{case}} {{result}}",
        "refuses": f"{sys.executable} -c exit(77) {{case}} {{result}}",
    }
    entries = [Peer(name=name, title=name, command=line) for name, line in commands.items()]
    cache = ResultCache(folder / "cached")
    cases = [load_case("block-fine")]
    made = compute_board(entries, cases, cache, time_limit=60.0, progress=in_silence)
    write_board(made, folder)
    return [folder / f"{name}.html" for name in ("index", "simulator-still", "case-block-fine")]


def findings(browser: Any, page: Path, scheme: str = "light") -> list[str]:
    """What axe finds grave on a page, with the element; on dark ground of contrast alone."""
    from axe_selenium_python import Axe

    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": features})
    browser.get(page.as_uri())
    axe = Axe(browser)
    axe.inject()
    rules = {"runOnly": {"type": "rule", "values": ["color-contrast"]}}
    return [
        f"{found['id']}: {node['html'][:150]}"
        for found in axe.run(options=rules if scheme == "dark" else None)["violations"]
        if found["impact"] in GRAVE
        for node in found["nodes"]
    ]


def overflow(browser: Any, page: Path, width: int) -> int:
    """By how many pixels a page is wider than a screen of this width."""
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    browser.get(page.as_uri())
    wide = browser.execute_script("return document.documentElement.scrollWidth")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    return int(wide) - width


def test_reports_and_scoreboard_have_no_grave_fault_and_fit_the_screen(
    browser: Any, pages: list[Path], board: list[Path]
) -> None:
    for page in (*pages, *board):
        for scheme in SCHEMES:
            assert findings(browser, page, scheme) == [], (page.name, scheme)
        assert [overflow(browser, page, width) <= 0 for width in WIDTHS] == [True, True], page.name


@pytest.mark.parametrize("width", [688, 710], ids=["A4", "Letter"])
def test_on_paper_all_is_there_and_nothing_is_cut(
    browser: Any, pages: list[Path], width: int
) -> None:
    """At the width of a sheet within its margins [CSS pixels]."""
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 970, "deviceScaleFactor": 1, "mobile": False},
    )
    for page in pages[:2]:
        browser.get(page.as_uri())
        shown = browser.execute_script(
            "const high = (s) => [...document.querySelectorAll(s)].map((n) => n.clientHeight);"
            "const cut = [...document.querySelectorAll('main *')]"
            ".filter((n) => n.getBoundingClientRect().right > innerWidth + 1);"
            "return [high('.case pre'), high('.viewer'), high('.screen, .screen pre'),"
            "cut.map((n) => n.outerHTML)]"
        )
        assert shown[0][0] > 100, "the case file is folded"
        # The whole record is for the screen: its few rows that matter are printed.
        assert shown[1] == [0]
        assert set(shown[2]) == {0}
        assert shown[3] == [], page.name


def test_the_verdicts_of_the_checks_are_in_sight_on_a_phone(
    browser: Any, pages: list[Path]
) -> None:
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 390, "height": 900, "deviceScaleFactor": 1, "mobile": True},
    )
    browser.get(pages[0].as_uri())
    right = browser.execute_script(
        "return Math.max(...[...document.querySelectorAll('#checks ~ .scroll td')]"
        ".filter((n) => /^(passed|failed)/.test(n.textContent))"
        ".map((n) => n.getBoundingClientRect().right))"
    )
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert 0 < right <= 390


def test_the_measures_see_a_fault(browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "bad.html"
    page.write_text(
        '<html lang="en"><title>bad</title><meta name="viewport" content="width=device-width">'
        "<style>@media (prefers-color-scheme: dark) { b { color: #333; background: #111 } }</style>"
        '<main><p style="color: #ccc; width: 900px">pale</p><b>black</b>'
        "<img src='data:,'></main></html>",
        "utf-8",
    )
    assert {line.partition(":")[0] for line in findings(browser, page)} == {
        "color-contrast",
        "image-alt",
    }
    assert len(findings(browser, page, "dark")) == len(findings(browser, page)) == 2
    assert any("black" in line for line in findings(browser, page, "dark"))
    assert overflow(browser, page, 390) > 0


@pytest.mark.skipif("PALPATE_DOCS" not in os.environ, reason="PALPATE_DOCS names no built docs")
def test_the_documentation_has_no_grave_fault_and_fits_the_screen(browser: Any) -> None:
    folder = Path(os.environ["PALPATE_DOCS"]).absolute()
    for name in DOCS:
        page = folder / f"{name}.html"
        for scheme in SCHEMES:
            assert findings(browser, page, scheme) == [], (name, scheme)
        assert [overflow(browser, page, width) <= 0 for width in WIDTHS] == [True, True], name
