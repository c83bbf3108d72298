"""A server in the test's own process, and a thousand messages that no page sends."""

from __future__ import annotations

import json
import random
import string
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.problem import Element
from palpate.validation.case import load_case
from palpate.validation.live.live_case import Touch
from palpate.validation.live.server import PageServer, ignore_broken_pipes

Serving = Callable[..., AbstractContextManager[PageServer]]


def _serving(folder: Path) -> Serving:
    @contextmanager
    def serve(
        case: str | Path,
        touch: Touch | None = None,
        elements: tuple[Element, ...] = (Element.LINEAR,),
        **options: Any,
    ) -> Iterator[PageServer]:
        server = PageServer(load_case(case), touch or Touch(), elements, folder=folder, **options)
        ready = threading.Event()
        ignore_broken_pipes()  # the server's thread cannot
        thread = threading.Thread(target=server.serve, args=(lambda _: ready.set(),), daemon=True)
        thread.start()
        assert ready.wait(30)
        try:
            yield server
        finally:
            server.stop()
            thread.join(10)
            assert not thread.is_alive()

    return serve


@pytest.fixture
def serving(tmp_path: Path) -> Serving:
    return _serving(tmp_path)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageServer]:
    """One server for many tests, each of which leaves it as it was."""
    with _serving(tmp_path_factory.mktemp("shared"))("block") as server:
        yield server


_PLACES = (
    "NaN", "Infinity", "-Infinity", "1e400", "1e300", "-1e8", '"1"', "null", "true", "[]", "{}",
)  # fmt: skip
_KINDS = ("tool", "grab", "pull", "pause", "colour", "record", "shown", "quit", "", "TOOL", "tool ")
_VALUES: tuple[Any, ...] = (
    None, -1, 2**63, 2**70, 1.5, "x", "1", [], [1], {}, [[1, 2, 3]], "\u2028",
)  # fmt: skip
_PROPER: tuple[dict[str, Any], ...] = (
    {"kind": "tool", "number": 3, "to": [1.5, -2, 0.0]},
    {"kind": "grab", "point": 12, "radius": 8.5},
    {"kind": "pull", "number": 4, "by": [0.0, -1.25, 3]},
    {"kind": "pause", "on": True},
    {"kind": "colour", "by": "stress"},
    {"kind": "record", "on": True},
    {"kind": "shown", "frame": 7},
)


def _wrong_place(chance: random.Random) -> str:
    """NaN, infinite, huge, or of another type, at one of three coordinates."""
    key, kind = chance.choice([("to", "tool"), ("by", "pull")])
    place = [str(round(chance.uniform(-50.0, 50.0), 3)) for _ in range(3)]
    place[chance.randrange(3)] = chance.choice(_PLACES)
    number = chance.randrange(1000)
    return f'{{"kind":"{kind}","number":{number},"{key}":[{",".join(place)}]}}'


def _wrong_type(chance: random.Random) -> str:
    message = dict(chance.choice(_PROPER))
    key = chance.choice([key for key in message if key != "kind"])
    message[key] = chance.choice(_VALUES)
    return json.dumps({**message, "seed": chance.randrange(10**6)})


def _cut(chance: random.Random) -> str:
    text = json.dumps({**chance.choice(_PROPER), "number": chance.randrange(10**6)})
    return text[: chance.randrange(len(text))]


def _other_kind(chance: random.Random) -> str:
    return json.dumps({"kind": chance.choice(_KINDS), "more": chance.randrange(10**6)})


def _noise(chance: random.Random) -> str:
    return "".join(chance.choices(string.printable + "é\u2028\x00", k=chance.randrange(1, 400)))


def _deep(chance: random.Random) -> str:
    return chance.choice("[{") * chance.randrange(1, 2000)


def _cut_frame(chance: random.Random) -> bytes:
    """The head of a frame, which only the server sends, and less than it promises."""
    head = json.dumps({"frame": chance.randrange(2**31), "panes": [{}]}).encode()
    data = struct.pack("<I", chance.choice([len(head), 2**32 - 1, 0])) + head
    return data[: chance.randrange(1, len(data))]


def _bytes(chance: random.Random) -> bytes:
    return chance.randbytes(chance.randrange(0, 300))


def _proper_as_bytes(chance: random.Random) -> bytes:
    return json.dumps({**chance.choice(_PROPER), "frame": chance.randrange(10**6)}).encode()


_MAKERS = (
    _wrong_place, _wrong_type, _cut, _other_kind, _noise, _deep, _cut_frame, _bytes,
    _proper_as_bytes,
)  # fmt: skip


def _malformed(count: int, seed: int = 20) -> list[str | bytes]:
    """So many, all different, of every kind in turn."""
    chance = random.Random(seed)
    made: dict[str | bytes, None] = {}
    while len(made) < count:
        made[_MAKERS[len(made) % len(_MAKERS)](chance)] = None
    return list(made)


@pytest.fixture(scope="session")
def malformed() -> list[str | bytes]:
    """A thousand messages, all different, none of which the protocol has."""
    return _malformed(1000)
