"""The live page in a browser without network, driven by a synthetic pointer."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.validation.live.live_case import Touch
from palpate.validation.live.server import PageServer

pytestmark = pytest.mark.browser

# A verdict without FEniCSx: an error for each pane on the same mesh, then none of the truth.
STUB = """
import sys
from pathlib import Path
import numpy as np
from palpate.validation.case import load_case
from palpate.validation.live.verdict import SAME_MESH, PaneVerdict, say
case, pose = map(Path, sys.argv[1:])
given = np.load(pose)
print("solving", flush=True)
length = np.linalg.norm(given["displacement"], axis=2)
panes = [PaneVerdict(str(n), v, ["displacement_l2 " + v], error)
         for n, v, error in zip(given["names"], ["failed", "passed"], length)]
used = np.unique(load_case(case).problem.mesh.boundary_facets)
say(case, SAME_MESH, panes, used)
sys.exit("a cell would invert")
"""


def wait(browser: Any, script: str, seconds: float = 30.0) -> Any:
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, seconds, 0.05).until(
        lambda b: b.execute_script(f"return {script}")
    )


def forces(browser: Any) -> np.ndarray:
    """On the tool in the last frame that was drawn [N], a row for each pane."""
    return np.array(json.loads(browser.execute_script("return document.body.dataset.forces")))


def serious(browser: Any) -> list[str]:
    return [e["message"] for e in browser.get_log("browser") if "GL Driver" not in e["message"]]


def picture(browser: Any) -> np.ndarray:
    from matplotlib import image

    png = browser.find_element("css selector", ".stage canvas").screenshot_as_png
    return np.asarray(image.imread(io.BytesIO(png)))[:, :, :3].mean(axis=2)


@pytest.fixture
def page(browser: Any, serving) -> Iterator[PageServer]:
    browser.get_log("browser")
    with serving("block", Touch(mass_damping=100.0)) as server:
        browser.set_window_size(900, 420)
        browser.get(server.address)
        wait(browser, "Number(document.body.dataset.time) > 0")
        yield server
        browser.get("about:blank")


def dragged(browser: Any, right: int, down: int) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    canvas = browser.find_element("css selector", ".stage canvas")
    hand = ActionChains(browser, duration=50).move_to_element(canvas).click_and_hold()
    hand.move_by_offset(right, down).release().perform()


# Middle of the first view's body, in pixels from the canvas's middle.
MIDDLE = """
const s = window.palpate.stage, { w, h, pixels, dense, centre } = s.layout, sum = [0, 0, 0];
s.points.forEach((x, k) => { sum[k % 3] += x / s.count; });
const [right, up] = s.axes().map((axis) => axis[0] * sum[0] + axis[1] * sum[1] + axis[2] * sum[2]);
return [(w / 2 + (right - centre[0]) * pixels) / dense - s.canvas.clientWidth / 2,
  (h / 2 - (up - centre[1]) * pixels) / dense - s.canvas.clientHeight / 2];
"""


def dragged_from_a_body(browser: Any, right: int) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    canvas = browser.find_element("css selector", ".stage canvas")
    hand = ActionChains(browser, duration=50)
    hand.move_to_element_with_offset(canvas, *map(int, browser.execute_script(MIDDLE)))
    hand.click_and_hold().move_by_offset(right, 0).release().perform()


def test_the_tool_pushes_bodies_that_push_back(browser: Any, page: PageServer) -> None:
    from selenium.webdriver.common.keys import Keys

    whole = picture(browser)
    halves = [whole] if whole.shape[1] < 600 else np.array_split(whole, 2, axis=1)
    assert all(0.05 < (half < 0.95).mean() < 0.9 for half in halves)
    assert (forces(browser) == 0.0).all()
    # The tool waits at the end that is free, right of the body: to the left is into it.
    dragged(browser, -120, 0)
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
    assert np.abs(picture(browser) - whole).mean() > 1e-3
    before = page.simulation.pointer.position.copy()
    browser.find_element("css selector", ".stage canvas").send_keys(Keys.ARROW_RIGHT * 3)
    browser.find_element("id", "withdraw").click()
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => Math.hypot(...f) === 0)")
    assert page.simulation.pointer.position[0] > before[0]
    # Taken hold of in the middle and drawn to the right, the bodies pull back to the left.
    browser.execute_script("document.getElementById('keep').checked = true")
    browser.find_element("id", "mode-drag").click()
    dragged_from_a_body(browser, 40)
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] < -0.001)")
    browser.find_element("id", "keep").click()
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => Math.hypot(...f) === 0)")
    assert serious(browser) == []


@pytest.mark.usefixtures("page")
def test_fingers_push_as_a_mouse_does(browser: Any) -> None:
    point = browser.execute_script(
        "const b = document.querySelector('.stage canvas').getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]"
    )
    touch = lambda kind, *at: browser.execute_cdp_cmd(  # noqa: E731
        "Input.dispatchTouchEvent",
        {"type": kind, "touchPoints": [{"x": x, "y": point[1]} for x in at]},
    )
    touch("touchStart", point[0])
    for part in range(1, 7):
        touch("touchMove", point[0] - 20 * part)
    touch("touchEnd")
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
    assert serious(browser) == []


@pytest.mark.usefixtures("page")
def test_all_that_is_promised_is_shown(browser: Any) -> None:
    dragged(browser, -120, 0)
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
    wait(browser, "document.getElementById('latency').textContent.endsWith('ms')")
    wait(browser, "Number(document.querySelector('#numbers td:nth-child(2)').textContent) > 0.01")
    rows = browser.execute_script(
        "return [...document.querySelectorAll('#numbers tbody tr, #pace dt')]"
        ".map((n) => [n.firstElementChild ? n.firstElementChild.textContent : n.textContent,"
        "n.nextElementSibling?.matches('dd') ? n.nextElementSibling.textContent : n.textContent])"
    )
    numbers = dict(rows)
    assert list(numbers) == [
        "force [N]", "Δ volume [%]", "energy [mJ]", "smallest det F", "real-time factor",
        "time of the bodies", "time step", "frames per second", "latency, pointer to picture",
        "of it the server's",
    ]  # fmt: skip
    assert all(any(letter.isdigit() for letter in rest) for rest in numbers.values())
    inked = browser.execute_script(
        "const c = document.getElementById('chart');"
        "return new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size"
    )
    assert inked > 10
    for name, said in (
        ("strain", "equivalent strain"),
        ("stress", "von Mises stress"),
        ("displacement", "displacement"),
    ):
        browser.execute_script(
            "const s = document.getElementById('colour'); s.value = arguments[0];"
            "s.dispatchEvent(new Event('change'))",
            name,
        )
        wait(browser, f"document.getElementById('quantity').textContent === 'colour: {said}'")


def findings(browser: Any) -> list[str]:
    """What axe finds grave, with the element."""
    from axe_selenium_python import Axe

    axe = Axe(browser)
    axe.inject()
    return [
        f"{found['id']}: {node['html'][:150]}"
        for found in axe.run()["violations"]
        if found["impact"] in ("serious", "critical")
        for node in found["nodes"]
    ]


@pytest.mark.usefixtures("page")
def test_the_page_has_no_grave_fault_and_fits_the_screen(browser: Any) -> None:
    """By day and by night, on a phone and a desk."""
    try:
        for scheme, paper in (("dark", "rgb(20, 24, 29)"), ("light", "rgb(255, 255, 255)")):
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
            wait(browser, f"getComputedStyle(document.body).backgroundColor === '{paper}'")
            for width in (390, 1400):
                size = {"width": width, "height": 844, "deviceScaleFactor": 1}
                browser.execute_cdp_cmd(
                    "Emulation.setDeviceMetricsOverride", {**size, "mobile": width < 600}
                )
                wait(browser, f"innerWidth === {width}")
                assert findings(browser) == [], (scheme, width)
                wide = browser.execute_script("return document.documentElement.scrollWidth")
                assert wide <= width
        browser.execute_script("document.getElementById('about').style.color = '#ccc'")
        assert [line.partition(":")[0] for line in findings(browser)] == ["color-contrast"]
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_pause_record_reset_and_a_second_window(
    browser: Any, page: PageServer, tmp_path: Path
) -> None:
    press = lambda name: browser.find_element("id", name).click()  # noqa: E731
    press("record")
    wait(browser, "document.getElementById('record').textContent === 'end the recording'")
    dragged(browser, -60, 10)
    wait(browser, "Number(document.body.dataset.time) > 0.4")
    press("record")
    wait(browser, "document.getElementById('notes').textContent.includes('palpate gate')")
    assert [path.name for path in tmp_path.glob("*.toml")] == ["touched-block-1.toml"]
    press("pause")
    wait(browser, "document.getElementById('pause').getAttribute('aria-pressed') === 'true'")
    at = browser.execute_script("return document.body.dataset.time")
    browser.execute_script(
        "const s = document.getElementById('colour'); s.value = 'stress';"
        "s.dispatchEvent(new Event('change'))"
    )
    wait(browser, "document.querySelector('.most').textContent.endsWith('kPa')")
    assert browser.execute_script("return document.body.dataset.time") == at
    press("reset")
    wait(browser, "Number(document.body.dataset.time) === 0")
    browser.switch_to.new_window("tab")
    browser.get(page.address)
    wait(browser, "(document.body.dataset.status ?? '').startsWith('refused')")
    # In words on the stage, which without a body would be black.
    warning = browser.find_element("id", "warning")
    assert warning.is_displayed()
    assert warning.text == (
        "another window touches this body: go on there, or close it and reload this page"
    )
    assert not browser.find_element("css selector", ".stage canvas").is_displayed()
    browser.close()
    browser.switch_to.window(browser.window_handles[0])
    press("pause")
    wait(browser, "Number(document.body.dataset.time) > 0.02")
    assert serious(browser) == []
    page.stop()
    wait(browser, "document.body.dataset.status === 'the simulation has ended'")
    assert "start palpate touch again" in browser.find_element("id", "warning").text


def test_what_is_judged_shows_verdicts_and_errors(
    browser: Any, page: PageServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(page.simulation.panes) == 2
    (tmp_path / "stub_of_verdict.py").write_text(STUB)
    monkeypatch.setattr("palpate.validation.live.judging.VERDICT", "stub_of_verdict")
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: True)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{':'.join(sys.path)}")
    browser.find_element("id", "judge").click()
    wait(browser, "document.body.dataset.judged")
    assert "nothing acts" in browser.find_element("id", "notes").text
    browser.find_element("id", "reset").click()
    dragged(browser, -150, 0)
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
    browser.find_element("id", "judge").click()
    wait(browser, "document.body.dataset.verdicts === 'failed passed'")
    # No truth: that is said, and what was found on the same mesh stays.
    wait(browser, "document.body.dataset.judged === 'none'")
    assert browser.find_element("id", "judge").is_enabled()
    said = browser.find_element("id", "notes").text
    assert "the truth was not found" not in said  # it stands beside its question, once
    assert "settled" in said
    # The answers stand beside the buttons, where they are seen at once.
    answers = browser.find_element("id", "verdicts")
    assert "is it solved right?" in answers.text
    assert "linear strain: failed" in answers.text
    assert "is it what tissue does?\nnot known the truth was not found: a cell" in answers.text
    box = "document.getElementById('verdicts').getBoundingClientRect()"
    assert browser.execute_script(f"return {box}.top < 420")
    assert not browser.find_element("id", "progress").is_displayed()
    legend = browser.find_element("id", "quantity").text
    assert legend == "colour: distance from the reference on the same mesh, in mm"
    # The colours are the errors: of the stub all of the displacement, largest under the tool.
    shades = browser.execute_script(
        "const s = window.palpate.stage;"
        "return s.shown.map((shown) => Array.from(s.stateOf(shown).shade))"
    )
    assert max(max(shade) for shade in shades) == pytest.approx(1.0)
    assert all(0.0 <= min(shade) < 0.05 < max(shade) for shade in shades)
    names = browser.execute_script(
        "return [...document.querySelectorAll('.view .name')].map((n) => n.textContent)"
    )
    assert names == [
        "linear strain: failed against the same mesh",
        "Green strain: passed against the same mesh",
    ]
    # The end of the scale, whose quantity stands above: no number that reads as the error.
    assert re.fullmatch(r"[0-9.]+ mm", browser.find_element("css selector", ".most").text)
    assert (tmp_path / "held-block-1.toml").exists()
    # The page's width at a phone's.
    browser.set_window_size(500, 900)
    assert browser.execute_script(
        "return document.documentElement.scrollWidth <= window.innerWidth"
    )
    assert serious(browser) == []


def test_shadow_and_ghost_show_how_deep_the_tool_is(browser: Any, page: PageServer) -> None:
    """Each is seen: the picture without it is another one. A body at rest is light, not dark."""
    del page
    resting = picture(browser)
    body = resting[resting < 0.95]
    assert np.median(body) > 0.45
    dragged(browser, -120, 0)
    wait(browser, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
    browser.find_element("id", "pause").click()
    wait(browser, "document.getElementById('pause').getAttribute('aria-pressed') === 'true'")
    whole = picture(browser)
    for without in ("s.caster.radius = 0", "s.shown.forEach((shown) => { shown.moved = 0; })"):
        browser.execute_script(f"const s = window.palpate.stage; {without}; s.paint();")
        other = picture(browser)
        assert (np.abs(other - whole) > 0.02).sum() > 20, without
        whole = other
    assert serious(browser) == []


# Counts how often the bodies' time has begun again: a busy machine may show the first frame late.
COUNT_BEGINNINGS = """
const stage = window.palpate.stage, paint = stage.onPaint;
window.beginnings = 0;
stage.onPaint = (head) => {
  if (head.time < window.last) ++window.beginnings;
  window.last = head.time;
  paint(head);
};
"""


def verdicts_of(browser: Any, right: int, down: int) -> str:
    """Of the pose after a drag from rest, on the same mesh."""
    wait(browser, "window.last > 1.0", 120.0)
    before = browser.execute_script("return window.beginnings")
    browser.find_element("id", "reset").click()
    wait(browser, f"window.beginnings > {before}", 120.0)
    dragged(browser, right, down)
    touched = "JSON.parse(document.body.dataset.forces).every((f) => Math.hypot(...f) > 1e-3)"
    wait(browser, touched, 120.0)
    browser.find_element("id", "judge").click()
    wait(browser, "document.body.dataset.verdicts", 500.0)
    found: str = browser.execute_script("return document.body.dataset.verdicts")
    return found


def judged_alike(browser: Any, server: PageServer, way: tuple[int, int], tries: int) -> None:
    browser.set_window_size(1400, 900)
    browser.get(server.address)
    wait(browser, "Number(document.body.dataset.time) > 0")
    browser.execute_script(COUNT_BEGINNINGS)
    found = [verdicts_of(browser, *way) for _ in range(2 * tries)]
    browser.get("about:blank")
    assert found == ["passed passed"] * (2 * tries)


@pytest.mark.dolfinx
def test_a_held_pose_is_judged_twice_alike(browser: Any, serving) -> None:
    with serving("block", Touch(mass_damping=100.0)) as server:
        judged_alike(browser, server, (-150, 0), 1)


@pytest.mark.dolfinx
@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(
    ("name", "way"), [("kidney", (20, 128)), ("block", (-150, 0)), ("press", (0, 110))]
)
def test_a_pose_held_deep_is_judged_twice_alike_in_ten_of_ten_tries(
    browser: Any, serving, name: str, way: tuple[int, int]
) -> None:
    with serving(name) as server:
        judged_alike(browser, server, way, 10)
