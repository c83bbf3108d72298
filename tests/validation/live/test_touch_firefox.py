"""The live page in Firefox, by WebDriver BiDi: it draws, and the hand pushes."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bidi import Firefox, firefox

from palpate.validation.live.live_case import Touch

pytestmark = pytest.mark.browser


def until(page: Firefox, script: str, seconds: float = 30.0) -> Any:
    end = time.monotonic() + seconds
    while not (found := page.value(script)):
        assert time.monotonic() < end, script
        time.sleep(0.1)
    return found


def test_the_tool_pushes_in_firefox(
    serving, tmp_path: Path, require_browser_tests: Callable[[str], None]
) -> None:
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    if program is None or shutil.which("Xvfb") is None:
        require_browser_tests("firefox-esr or xvfb")
    assert program is not None
    with (
        serving("block", Touch(mass_damping=100.0)) as server,
        firefox(program, tmp_path) as page,
    ):
        page.open(server.address, 900, 420)
        until(page, "Number(document.body.dataset.time) > 0")
        assert page.value("document.querySelector('.touch').dataset.state") == "drawn"
        box = "document.querySelector('.stage canvas').getBoundingClientRect()"
        left, top, wide, high = page.value(
            f"(({{x, y, width, height}}) => [x, y, width, height])({box})"
        )
        page.drag((int(left + wide / 2), int(top + high / 2)), (-120, 0))
        until(page, "JSON.parse(document.body.dataset.forces).every((f) => f[0] > 0.01)")
        page.value("document.getElementById('withdraw').click()")
        rests = "JSON.parse(document.body.dataset.forces).every((f) => Math.hypot(...f) === 0)"
        until(page, rests)
        # The picture is not of one colour: bodies, tool and ground.
        shades = page.value(
            "(() => { const { canvas: c, gl: g } = window.palpate.stage;"
            "const bytes = new Uint8Array(4 * c.width * c.height);"
            "g.readPixels(0, 0, c.width, c.height, g.RGBA, g.UNSIGNED_BYTE, bytes);"
            "return new Set(bytes).size; })()"
        )
        assert shades > 10
        # While it is paused, how to go on hides no word of the legend, and is the button's name.
        page.value("document.getElementById('pause').click()")
        until(page, "!document.getElementById('warning').hidden")
        assert page.value("document.getElementById('pause').textContent") == "go on"
        boxes = page.value(
            "['quantity', 'warning'].map((id) => document.getElementById(id))"
            ".map((one) => one.getBoundingClientRect()).map((b) => [b.right, b.bottom, b.x, b.y])"
        )
        (right, bottom, *_), (*_, left, top) = boxes
        assert left >= right or top >= bottom
        assert page.errors == []
