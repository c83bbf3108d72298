"""The local server: one page by its token and its own origin; nothing that comes can harm it."""

from __future__ import annotations

import base64
import builtins
import contextlib
import functools
import os
import re
import socket
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.validation.case import load_case
from palpate.validation.live.bench_touch import Client, connected
from palpate.validation.live.live_case import Touch
from palpate.validation.live.server import IN_USE, PageServer, TouchUnavailableError
from palpate.validation.live.verdict import ASKED, SAME_MESH


def get(address: str, **headers: str) -> tuple[int, dict[str, str], str]:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, dict(response.headers), response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, dict(error.headers), error.read().decode()


def test_the_page_is_given_by_its_token_alone_and_fetches_nothing(serving) -> None:
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


def test_a_page_of_another_origin_gets_no_socket(serving) -> None:
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


def test_a_second_page_is_refused_and_the_first_goes_on(serving) -> None:
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


def test_a_thousand_malformed_messages_harm_nothing(serving, malformed: list[str | bytes]) -> None:
    with serving("block") as server, connected(server.address) as client:
        x, y, z = client.scene["tool"]["start"]
        client.say("tool", number=1, to=[x - 6.0, y, z])
        refused = 0
        for number, message in enumerate(malformed, start=1):
            client.socket.send(message)
            while (number % 100 == 0 or number == len(malformed)) and refused < number:
                refused += client.hear().get("kind") == "refused"
        assert refused == len(malformed)
        # The bodies go on, where the last proper message sent the tool.
        begin = client.until_time(0.0)["time"]
        head = client.until_time(begin + 0.3)
        assert head["tool"] == pytest.approx([x - 6.0, y, z], abs=1e-3)
        assert not any(pane["trouble"] for pane in head["panes"])
        assert np.isfinite(client.positions(len(server.simulation.surface.used))).all()


def raw(server: PageServer, path: str = "socket") -> socket.socket:
    """A connection to the server, its socket asked for and granted."""
    host, _, token = server.address.removeprefix("http://").strip("/").partition("/")
    wire = socket.create_connection(tuple(host.split(":")), timeout=10)
    key = base64.b64encode(b"0123456789abcdef").decode()
    wire.sendall(
        f"GET /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
        f"Origin: http://{host}\r\n\r\n".encode()
    )
    assert b" 101 " in wire.recv(4096)
    return wire


@contextmanager
def patiently_connected(server: PageServer) -> Iterator[Client]:
    """As soon as the socket before has been given up."""
    from websockets.exceptions import ConnectionClosed

    for _ in range(100):
        with contextlib.suppress(ConnectionClosed), connected(server.address) as client:
            yield client
            return
        time.sleep(0.05)
    raise AssertionError("the socket before is still in use")


# Header with the client's mask bit, the mask, and what follows: less than promised, no text, not
# masked, of a reserved kind, too long a control frame, a continuation of nothing.
@pytest.mark.parametrize(
    "frame",
    [b"\x81", b"\x81\x85\0\0\0\0{", b"\x81\xfe\x07", b"\x81\xff" + b"\xff" * 8 + b"\0" * 8,
     b"\x81\x82\0\0\0\0\xff\xfe", b"\x81\x02{}", b"\x83\x80\0\0\0\0", b"\xf1\x80\0\0\0\0",
     b"\x89\xfe\x00\xff\0\0\0\0", b"\x80\x82\0\0\0\0{}", b"\x88\x81\0\0\0\0\x03", b"\0" * 500,
     b"GET / HTTP/1.1\r\n\r\n"],
    ids=repr,
)  # fmt: skip
def test_a_broken_frame_ends_that_socket_only(shared, frame: bytes) -> None:
    with raw(shared) as wire:
        wire.sendall(frame)
    with patiently_connected(shared) as client:
        begin = client.hear().get("time", 0.0)
        client.until_time(begin + 0.05)


@pytest.mark.parametrize("begun", [b"", b"GET", b"GET / HTTP/1.1\r\nHost: ", b"\x16\x03\x01\0"])
def test_half_a_request_ends_nothing(shared, begun: bytes) -> None:
    host, port = shared.address.split("/")[2].split(":")
    with socket.create_connection((host, int(port)), timeout=10) as wire:
        wire.sendall(begun)
    with patiently_connected(shared) as client:
        client.until_time(0.0)


def test_a_socket_that_asks_for_nothing_does_not_hold_up_the_end(
    serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Browsers open one in advance; `serving` fails when the server has not ended in time."""
    from websockets.asyncio.server import serve

    monkeypatch.setattr(
        "websockets.asyncio.server.serve", functools.partial(serve, open_timeout=600.0)
    )
    with contextlib.ExitStack() as stack, serving("block") as server:
        host, port = server.address.split("/")[2].split(":")
        stack.enter_context(socket.create_connection((host, int(port)), timeout=10))
        get(server.address)  # the socket, which came first, has been accepted


def test_a_message_that_is_too_long_ends_that_socket_only(serving) -> None:
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


def test_it_ends_when_the_page_stays_away(serving) -> None:
    with serving("block", patience=0.05) as server:
        with connected(server.address) as client:
            client.until_time(0.05)
        server.simulation.join(10)
        assert not server.simulation.is_alive()


def test_a_page_that_comes_back_keeps_it_awake(serving) -> None:
    with serving("block", patience=1.0) as server:
        with connected(server.address) as client:
            client.until_time(0.05)
        with connected(server.address):
            server.simulation.join(1.5)
            assert server.simulation.is_alive()
        server.simulation.join(10)
        assert not server.simulation.is_alive()


def test_a_verdict_that_is_being_found_ends_with_the_server(
    serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
        told = client.until(lambda heard: heard.get("text", "").startswith(ASKED[SAME_MESH]))
        number = int(told["text"].split()[-1])
        os.kill(number, 0)
    for _ in range(100):
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("it was left behind")
