"""How the page is opened, and what a folder of recordings may lose: nothing."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from signals import PALPATE, default_signals

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh
from palpate.validation.case import load_case
from palpate.validation.live import opening
from palpate.validation.live.recording import free_name, write_case

# A browser that writes down its command line and what it opens.
BROWSER = """
import json, os, sys
from urllib.parse import unquote, urlparse
path = unquote(urlparse(sys.argv[1]).path)
with open("seen.new", "w") as file:
    about = os.stat(path)
    json.dump([open("/proc/self/cmdline").read(), about.st_mode, open(path).read()], file)
os.rename("seen.new", "seen.json")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_no_token_stands_in_the_browsers_command_line(tmp_path: Path) -> None:
    import json

    (tmp_path / "browser.py").write_text(BROWSER)
    browser = f"{sys.executable} {tmp_path / 'browser.py'} %s"
    seen = tmp_path / "seen.json"
    with subprocess.Popen(
        [*PALPATE, "touch", "block", "-o", "a #folder/of mine"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "BROWSER": browser},
        start_new_session=True,
        preexec_fn=default_signals,
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        while not seen.exists():  # the test's own time limit is the deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) in (0, 130)
    command, mode, text = json.loads(seen.read_text())
    token = address.split("/")[-2]
    assert token not in command
    assert "palpate" in command
    assert stat.S_IMODE(mode) == 0o600
    assert f'url={address}"' in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["browser.py", "seen.json"]


@pytest.mark.browser
def test_a_browser_finds_the_page_by_the_file(
    browser: Any, tmp_path: Path, serving: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening.webbrowser, "open", browser.get)
    with serving("block") as server, opening.opened(server.address, tmp_path / "a #b"):
        found = "return document.body.dataset.forces"
        end = time.monotonic() + 30.0
        while not browser.execute_script(found):
            assert time.monotonic() < end
            time.sleep(0.05)
        assert browser.current_url == server.address
        assert browser.execute_script("return document.referrer") == ""


def test_a_folder_that_cannot_be_written_is_an_error_and_a_used_one_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening.webbrowser, "open", lambda _: True)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="name another by -o"):
        opening.opened("http://x/", tmp_path / "file" / "touch").__enter__()
    with opening.opened("http://x/", tmp_path / "out" / "touch"):
        (tmp_path / "out" / "touch" / "recorded.toml").touch()
    assert [p.name for p in (tmp_path / "out" / "touch").iterdir()] == ["recorded.toml"]


def test_a_name_is_free_where_neither_case_nor_solution_is(tmp_path: Path) -> None:
    (tmp_path / "held-1.npz").touch()
    (tmp_path / "held-2.toml").symlink_to("nowhere")
    assert free_name(tmp_path, "held") == "held-3"


def test_a_recording_beside_another_body_of_that_name_is_refused(
    tmp_path: Path, write_case_of: Callable[[float], Path]
) -> None:
    """It would be a case of the other body."""
    case, folder = load_case(write_case_of(1.0)), tmp_path / "out"
    data = {"title": "touched"}
    for _ in range(2):
        write_case(case, data, folder, "touched")
    before = (folder / "body.vtu").read_bytes()
    other = load_case(write_case_of(0.5))
    with pytest.raises(InputError, match=r"body\.vtu: differs from .*; use another -o"):
        write_case(other, data, folder, "touched-2")
    assert (folder / "body.vtu").read_bytes() == before
    assert not (folder / "touched-2.toml").exists()


@pytest.fixture
def write_case_of(tmp_path: Path, write_case: Callable[..., Path]) -> Callable[[float], Path]:
    """Write a case on a box of that width [m] in body.vtu."""

    def write(width: float) -> Path:
        write_mesh(tmp_path / "body.vtu", brick_box((4, 2, 2), (2.0, width, 1.0)))
        shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
        return write_case((shape, 'mesh = "body.vtu"'))

    return write
