"""What a reader without a mouse, with a small screen or weak eyes meets: axe finds nothing grave.

Reports always; the documentation too where PALPATE_DOCS says where it was built.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.problem import Element
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.report import html
from palpate.validation.simulators.candidate import fastsim_candidate

pytestmark = pytest.mark.browser
GRAVE = ("serious", "critical")
# A phone, a desk.
WIDTHS = (390, 1400)
DOCS = (
    "index", "start", "made/cases", "made/cases/kidney", "made/keys", "made/judge_my_simulator",
    "api",
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


def findings(browser: Any, page: Path) -> list[str]:
    """What axe finds grave on a page, with the element."""
    from axe_selenium_python import Axe

    browser.get(page.as_uri())
    axe = Axe(browser)
    axe.inject()
    return [
        f"{found['id']}: {node['html'][:150]}"
        for found in axe.run()["violations"]
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


def test_reports_have_no_grave_fault_and_fit_the_screen(browser: Any, pages: list[Path]) -> None:
    for page in pages:
        assert findings(browser, page) == [], page.name
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
            "return [high('details pre'), high('.viewer'), cut.map((n) => n.outerHTML)]"
        )
        assert shown[0][0] > 100, "the case file is folded"
        assert shown[1:] == [[0], []], page.name
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


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
        '<main><p style="color: #ccc; width: 900px">pale</p>'
        "<img src='data:,'></main></html>",
        "utf-8",
    )
    assert {line.partition(":")[0] for line in findings(browser, page)} == {
        "color-contrast",
        "image-alt",
    }
    assert overflow(browser, page, 390) > 0


@pytest.mark.skipif("PALPATE_DOCS" not in os.environ, reason="PALPATE_DOCS names no built docs")
def test_the_documentation_has_no_grave_fault_and_fits_the_screen(browser: Any) -> None:
    folder = Path(os.environ["PALPATE_DOCS"]).absolute()
    for name in DOCS:
        page = folder / f"{name}.html"
        assert findings(browser, page) == [], name
        assert [overflow(browser, page, width) <= 0 for width in WIDTHS] == [True, True], name
