"""The local server: one page by its token and its own origin; nothing that comes can harm it."""

from __future__ import annotations

import builtins
import os
import random
import re
import string
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from palpate.validation.case import load_case
from palpate.validation.live.client import connected
from palpate.validation.live.live_case import Touch
from palpate.validation.live.server import IN_USE, PageServer, TouchUnavailableError

Serving = Callable[..., AbstractContextManager[PageServer]]


def get(address: str, **headers: str) -> tuple[int, dict[str, str], str]:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, dict(answer.headers), answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, dict(error.headers), error.read().decode()


def test_the_page_is_given_by_its_token_alone_and_fetches_nothing(serving: Serving) -> None:
    with serving("block") as server:
        status, headers, page = get(server.address)
        assert status == 200
        assert "Block, pulled and sheared" in page
        assert len(page) < 1_000_000
        assert not re.search(r"(src|href)=.?(https?:)?//", page)
        policy = headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'")
        assert "unsafe" not in policy
        assert headers["Cache-Control"] == "no-store"
        root, token = server.address.rsplit("/", 2)[:2]
        wrong = token[:-1] + ("a" if token[-1] != "a" else "b")
        for path in ("", f"{wrong}/", f"{wrong}/socket", "é".encode().hex()):
            assert get(f"{root}/{path}")[0] == 403, path
        assert get(server.address + "other")[0] == 404
        # A name that leads here by DNS is not this page.
        assert get(server.address, Host="evil.example")[0] == 403


def test_a_page_of_another_origin_gets_no_socket(serving: Serving) -> None:
    from websockets.exceptions import InvalidStatus

    with serving("block") as server:
        for origin in (
            "http://evil.example",
            "null",
            server.address.replace("http", "https"),
            None,
        ):
            with (
                pytest.raises(InvalidStatus, match="403"),
                connected(server.address, origin=origin),
            ):
                pass


def test_a_second_page_is_refused_and_the_first_goes_on(serving: Serving) -> None:
    from websockets.exceptions import ConnectionClosed

    with serving("block") as server:
        with connected(server.address) as first:
            first.until_time(0.05)
            with pytest.raises(ConnectionClosed) as refused, connected(server.address):
                pass
            assert refused.value.rcvd is not None
            assert refused.value.rcvd.code == IN_USE
            first.until_time(first.frames[-1]["time"] + 0.05)
        # Once it has gone another one may come, and finds the bodies as they were.
        with connected(server.address) as next_one:
            assert next_one.hear()["time"] > 0.05


def test_a_thousand_malformed_messages_harm_nothing(serving: Serving) -> None:
    chance = random.Random(20)
    with serving("block") as server, connected(server.address) as client:
        for _ in range(1000):
            text = '{"kind":"tool","number":1,"to":[1,2,3]}'
            noise = "".join(chance.choices(string.printable, k=chance.randrange(1, 60)))
            place = chance.randrange(len(text))
            text = chance.choice([noise, text[:place], text[:place] + noise + text[place:]])
            client.socket.send(chance.choice([text, text.encode()]))
        client.say("colour", by="strain")
        assert client.until(lambda heard: heard.get("colour") == "strain")["time"] >= 0.0
        assert any(note["kind"] == "refused" for note in client.notes)


def test_a_message_that_is_too_long_ends_that_socket_only(serving: Serving) -> None:
    from websockets.exceptions import ConnectionClosed

    with serving("block") as server:
        with connected(server.address) as client:
            client.socket.send("x" * 100_000)
            with pytest.raises(ConnectionClosed):
                client.until_time(1e9)
        with connected(server.address) as client:
            client.until_time(0.0)


def test_without_its_library_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = builtins.__import__

    def missing(name: str, *more: Any) -> Any:
        if name == "websockets":
            raise ImportError(name)
        return own(name, *more)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(TouchUnavailableError, match=r'pip install "palpate\[touch\]"'):
        PageServer(load_case("block"), Touch(), (), folder=tmp_path)


def test_it_ends_when_the_page_has_gone_if_asked_for_once(
    serving: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.validation.live.server._GONE", 0.05)
    with serving("block", is_once=True) as server:
        with connected(server.address) as client:
            client.until_time(0.05)
        server.simulation.join(10)
        assert not server.simulation.is_alive()


def test_the_command_ends_with_its_page(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "palpate.validation.cli", "touch", "block", "--once"]
    with subprocess.Popen(
        [*command, "--no-browser", "-o", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        with connected(address) as client:
            client.until_time(0.02)
            client.socket.socket.close()  # as a page that was killed
        assert process.wait(30) == 0


def test_a_verdict_that_is_being_found_ends_with_the_server(
    serving: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sleeper = "import os, sys, time; print(os.getpid(), flush=True); time.sleep(600)"
    (tmp_path / "sleeping_verdict.py").write_text(sleeper)
    monkeypatch.setattr("palpate.validation.live.judging.VERDICT", "sleeping_verdict")
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: True)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.pathsep.join(sys.path)}")
    touch = Touch(mass_damping=100.0)
    with serving("block", touch) as server, connected(server.address) as client:
        x, y, z = client.scene["tool"]["start"]
        client.say("tool", number=1, to=[x - 6.0, y, z])
        client.until_time(0.3)
        client.say("judge")
        number = int(client.until(lambda heard: heard.get("kind") == "progress")["text"])
        os.kill(number, 0)
    for _ in range(100):
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("it was left behind")
