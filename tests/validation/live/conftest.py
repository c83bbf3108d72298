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


PROPER: tuple[dict[str, Any], ...] = (
    {"kind": "tool", "number": 3, "to": [1.5, -2, 0.0]},
    {"kind": "grab", "point": 12, "radius": 8.5},
    {"kind": "pull", "number": 4, "by": [0.0, -1.25, 3]},
    {"kind": "let_go"},
    {"kind": "withdraw"},
    {"kind": "pause", "on": True},
    {"kind": "reset"},
    {"kind": "colour", "by": "stress"},
    {"kind": "loads", "on": False},
    {"kind": "record", "on": True},
    {"kind": "judge"},
    {"kind": "shown", "frame": 7},
)


@pytest.fixture(params=PROPER, ids=lambda message: message["kind"])
def proper(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Each message that the protocol has."""
    message: dict[str, Any] = request.param
    return message


# Not allowed for any key of any of them.
_VALUES: tuple[Any, ...] = (
    None, -1, 2**63, 1e300, float("nan"), float("inf"), "x", "1", [], [1], [0, 0], [0, 0, "1"],
    [0, 0, 1e300], [0, 0, float("nan")], [0, float("-inf"), 0], [0, None, 0], {}, [[1, 2, 3]],
    "tool ", "TOOL", "quit", ["tool"],
)  # fmt: skip


def _malformed(count: int) -> list[str | bytes]:
    """So many, all different: wrong values and keys, parts of messages and of frames, noise."""
    texts = [json.dumps(message) for message in PROPER]
    made: list[str | bytes] = [
        json.dumps({**message, key: value})
        for message in PROPER
        for key in message
        for value in _VALUES
    ]
    made += [json.dumps({**message, "more": 1}) for message in PROPER]
    made += [json.dumps(other) for other in (None, 1, True, "tool", [], {}, {"kind": "tool"})]
    made += ['{"kind":"tool","number":true,"to":[0,0,0]}', '{"kind":"pause","on":1}']
    made += ['{"kind":"shown","frame":2.5}', '{"kind":"grab","point":1,"radius":0.0}']
    made += ["NaN", "[" * 2000, "{" * 1000, texts[0] + "\x00", "1e400"]
    made += [text[:end] for text in texts for end in range(len(text))]
    # A frame, which only the server sends, with less than its head promises; messages as bytes.
    head = json.dumps({"frame": 7, "panes": [{}]}).encode()
    made += [struct.pack("<I", n) + head[:n] for n in (0, 1, len(head), 2**32 - 1)]
    made += [text.encode() for text in texts]
    made, chance = list(dict.fromkeys(made)), random.Random(20)
    while len(made) < count:
        made.append("".join(chance.choices(string.printable + "é\u2028\x00", k=60)))
        made.append(chance.randbytes(chance.randrange(1, 300)))
    return made


@pytest.fixture(scope="session")
def malformed() -> list[str | bytes]:
    """A thousand messages, all different, none of which the protocol has."""
    return _malformed(1000)
