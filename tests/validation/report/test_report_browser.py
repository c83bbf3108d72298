"""The report in a browser without network: no error, the 3-D view draws, its slider moves."""

from __future__ import annotations

import copy
import dataclasses
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.judging.results import CaseResult
from palpate.validation.report import html
from palpate.validation.report.pdf import find_browser, print_pdf
from palpate.validation.report.viewer import viewer_json

pytestmark = pytest.mark.browser


def picture(browser: Any) -> np.ndarray:
    """The canvas as it is on the screen, grey values."""
    from matplotlib import image
    from selenium.webdriver.common.by import By

    png = browser.find_element(By.CSS_SELECTOR, ".viewer canvas").screenshot_as_png
    return np.asarray(image.imread(io.BytesIO(png)))[:, :, :3].mean(axis=2)


def wait_until(browser: Any, script: str) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 30).until(lambda b: b.execute_script(f"return {script}"))


def serious(browser: Any) -> list[str]:
    """Console entries that are not the driver's remarks on its own speed."""
    return [
        entry["message"]
        for entry in browser.get_log("browser")
        if entry["level"] == "SEVERE" or "GL Driver Message" not in entry["message"]
    ]


def open_page(browser: Any, page: Path) -> None:
    browser.get_log("browser")
    browser.get(page.as_uri())
    wait_until(browser, "document.querySelector('.viewer').dataset.state !== undefined")


def choose(browser: Any, name: str) -> None:
    """What is compared, by its words in the list."""
    browser.execute_script(
        "const s = document.querySelector('.viewer select');"
        "s.value = [...s.options].find((o) => o.text === arguments[0]).value;"
        "s.dispatchEvent(new Event('change'));"
        "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));",
        name,
    )


def texts(browser: Any, selector: str) -> list[str]:
    """Words of all elements that a selector finds."""
    script = "return [...document.querySelectorAll(arguments[0])].map((n) => n.textContent)"
    found: list[str] = browser.execute_script(script, selector)
    return found


def move_slider(browser: Any, share: float) -> None:
    browser.execute_script(
        "const s = document.querySelector('.viewer input'); s.value = arguments[0];"
        "s.dispatchEvent(new Event('input'));"
        "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));",
        share,
    )


@pytest.mark.usefixtures("no_pictures")
def test_the_view_draws_turns_and_moves(browser: Any, kidney: CaseResult, tmp_path: Path) -> None:
    open_page(browser, html.write_report([kidney], tmp_path))
    assert serious(browser) == []
    state = "document.querySelector('.viewer').dataset.state"
    assert browser.execute_script(f"return {state}") == "drawn"
    choose(browser, "fastsim, Green strain with reference P1")
    whole = picture(browser)
    columns = np.array_split(whole, 4, axis=1)
    # A body in each of the four views, on white ground.
    assert all(0.1 < (column < 0.95).mean() < 0.9 for column in columns)
    # Candidate and reference on the same mesh look the same.
    width = min(columns[2].shape[1], columns[3].shape[1])
    assert np.abs(columns[2][:, :width] - columns[3][:, :width]).mean() < 0.02
    move_slider(browser, 0.0)
    rest = picture(browser)
    assert np.abs(rest - whole).mean() > 0.01
    # The original does not move with the slider.
    quarter = whole.shape[1] // 4
    assert np.abs(rest - whole)[:, quarter + 2 : 2 * quarter - 2].mean() < 1e-3
    move_slider(browser, 1.0)
    assert np.abs(picture(browser) - whole).mean() < 1e-3
    from selenium.webdriver.common.keys import Keys

    canvas = browser.find_element("css selector", ".viewer canvas")
    canvas.send_keys(Keys.ARROW_LEFT * 8)
    assert np.abs(picture(browser) - whole).mean() > 0.01
    assert serious(browser) == []


@pytest.mark.usefixtures("no_pictures")
def test_two_candidates_stand_below_their_errors_beside_the_reference(
    browser: Any, both: CaseResult, tmp_path: Path
) -> None:
    open_page(browser, html.write_report([both], tmp_path))
    assert texts(browser, ".view:not([hidden]) .name") == [
        "error of fastsim",
        "error of fastsim (smoothed)",
        "original: fixed blue, loaded red",
        "fastsim, Green strain",
        "fastsim (smoothed), Green strain",
        "reference P2, refined, Green strain",
    ]
    # States on one scale, errors on one scale.
    one, other, _, *states = texts(browser, ".view:not([hidden]) .most")
    assert len(set(states)) == 1
    assert one == other
    own = "fastsim with reference P1, fastsim (smoothed) with reference smoothed"
    choose(browser, f"Green strain: {own}")
    assert len(texts(browser, ".view:not([hidden]) .name")) == 7
    assert serious(browser) == []


@pytest.mark.usefixtures("no_pictures")
def test_a_motion_goes_through_its_times(browser: Any, tmp_path: Path) -> None:
    open_page(browser, html.write_report([judge_case(load_case("block-motion"))], tmp_path))
    shown = "return document.querySelector('.viewer output').textContent"
    assert browser.execute_script(shown) == "0.500 s"
    end = picture(browser)
    move_slider(browser, 5)
    assert browser.execute_script(shown) == "0.0500 s"
    assert np.abs(picture(browser) - end).mean() > 0.01
    # By keys alone: from the slider on to the list, from time to time, from look to look.
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    slider = browser.find_element("css selector", ".viewer input")
    for key, time in (
        (Keys.ARROW_RIGHT, "0.0600 s"),
        (Keys.HOME, "0.00 s"),
        (Keys.END, "0.500 s"),
    ):
        slider.send_keys(key)  # which does not wait for the page
        wait_until(browser, f"document.querySelector('.viewer output').textContent === '{time}'")
    slider.send_keys(Keys.TAB)
    assert browser.switch_to.active_element.tag_name == "select"
    names = texts(browser, ".view:not([hidden]) .name")
    browser.switch_to.active_element.send_keys(Keys.ARROW_DOWN)
    WebDriverWait(browser, 30).until(lambda b: texts(b, ".view:not([hidden]) .name") != names)
    browser.switch_to.active_element.send_keys(Keys.TAB)
    assert browser.switch_to.active_element.tag_name == "canvas"
    assert serious(browser) == []


@pytest.mark.usefixtures("no_pictures")
def test_a_tool_is_drawn_where_it_is(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With and without it the pixels differ, and the body is seen through it."""
    result = judge_case(load_case("block-motion"), diagnoses=False)
    points = result.problem.mesh.points
    high = points.max(axis=0)
    path = ToolPath([0.0, 0.5], [[*high[:2], 1.5 * high[2]], [*high[:2], 1.2 * high[2]]])
    # A motion that was solved without it: the view draws what the problem states.
    tool = RigidTool(shape=SphereShape(float(0.5 * high[2])), path=path)
    pictures = []
    for tools in ((), (tool,)):
        problem = copy.copy(result.problem)
        object.__setattr__(problem, "tools", tools)
        scene = viewer_json(dataclasses.replace(result, problem=problem))
        monkeypatch.setattr(html, "viewer_json", lambda _result, scene=scene: scene)
        open_page(browser, html.write_report([result], tmp_path))
        pictures.append(picture(browser))
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.01
    move_slider(browser, 0)
    assert np.abs(picture(browser) - pictures[1]).mean() > 0.005
    assert serious(browser) == []


@pytest.mark.usefixtures("no_pictures")
def test_a_hostile_case_does_no_harm(browser: Any, kidney: CaseResult, tmp_path: Path) -> None:
    hostile = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)>"
    states = tuple(dataclasses.replace(s, label=hostile + s.label) for s in kidney.states)
    text = f"# {hostile}\n{kidney.case_text}"
    result = dataclasses.replace(
        kidney, title=hostile, states=states, notes=(hostile,), case_text=text,
        evidence={"question": hostile, "context_of_use": hostile},
    )  # fmt: skip
    open_page(browser, html.write_report([result], tmp_path))
    assert browser.title.endswith(hostile)
    assert browser.execute_script("return document.querySelectorAll('script').length") == 2
    assert browser.execute_script("return document.querySelectorAll('img').length") == 0
    assert (
        browser.execute_script("return document.querySelector('.viewer').dataset.state") == "drawn"
    )
    assert serious(browser) == []


@pytest.mark.usefixtures("no_pictures")
def test_several_cases_are_linked_from_an_index(
    browser: Any, kidney: CaseResult, tmp_path: Path
) -> None:
    other = dataclasses.replace(kidney, name="other")
    page = html.write_report([kidney, other], tmp_path)
    assert page.name == "index.html"
    browser.get(page.as_uri())
    links = [a.get_attribute("href") for a in browser.find_elements("css selector", "td a")]
    assert [link.rsplit("/", 1)[1] for link in links] == ["kidney.html", "other.html"]
    browser.find_elements("css selector", "td a")[1].click()
    wait_until(browser, "document.querySelector('.viewer').dataset.state === 'drawn'")
    browser.find_element("css selector", "nav a").click()
    wait_until(browser, "document.querySelectorAll('td a').length === 2")


def test_the_report_prints_as_pdf(
    require_browser_tests: Any, kidney: CaseResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if find_browser() is None:
        require_browser_tests("chromium")
    page = html.write_report([kidney], tmp_path)
    made = print_pdf(page)
    assert made == tmp_path / "report.pdf"
    content = made.read_bytes()
    assert content.startswith(b"%PDF-")
    assert len(content) > 50_000
    assert b"/Outlines" in content  # headings as bookmarks
    assert not list(tmp_path.glob(".pdf.*"))
    if os.name == "posix":
        monkeypatch.setenv("PALPATE_BROWSER", "false")
        from palpate.meshes.errors import InputError

        with pytest.raises(InputError, match="could not print"):
            print_pdf(page)
        assert made.read_bytes() == content


@pytest.mark.usefixtures("no_pictures")
def test_a_box_shows_and_hides_inclusions(
    browser: Any, lump_result: CaseResult, tmp_path: Path
) -> None:
    page = html.write_report([lump_result], tmp_path)
    open_page(browser, page)
    state = "return document.querySelector('.viewer').dataset.state"
    assert browser.execute_script(state) == "drawn"
    assert [text.split(":")[0].strip() for text in texts(browser, ".inside span")] == [
        "inclusion 1", "inclusion 2",
    ]  # fmt: skip
    seen = picture(browser)
    opacity = "return getComputedStyle(document.querySelector('.bar')).opacity"
    assert browser.execute_script(opacity) == "0.5"
    box = browser.find_element("css selector", ".inside input")
    box.click()
    browser.execute_script(
        "return new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(f)))"
    )
    solid = picture(browser)
    assert browser.execute_script(opacity) == "1"
    assert np.abs(seen - solid).mean() > 0.01
    assert serious(browser) == []
    # Nothing of it stands on the page of a body without inclusions.
    plain = page.read_text("utf-8")
    assert plain.count('class="inside"') == 1
