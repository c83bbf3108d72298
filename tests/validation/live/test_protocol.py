"""Messages of the page and frames to it: strict, small, and nothing in them does harm."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from palpate.validation.live.frames import Box, pack_frame, unpack_frame
from palpate.validation.live.protocol import MessageError, read_message

PROPER: list[dict[str, Any]] = [
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
]
WRONG: list[Any] = [
    None, 1, "tool", [], {}, {"kind": "tool"}, {"kind": "quit"}, {"kind": ["tool"]},
    {"kind": "tool", "number": -1, "to": [0, 0, 0]},
    {"kind": "tool", "number": True, "to": [0, 0, 0]},
    {"kind": "tool", "number": 1, "to": [0, 0]},
    {"kind": "tool", "number": 1, "to": [0, 0, "1"]},
    {"kind": "tool", "number": 1, "to": [0, 0, 1e300]},
    {"kind": "tool", "number": 1, "to": [0, 0, float("nan")]},
    {"kind": "tool", "number": 1, "to": [0, 0, float("inf")]},
    {"kind": "tool", "number": 1, "to": [0, 0, 0], "more": 1},
    {"kind": "grab", "point": 12, "radius": 0.0}, {"kind": "pause", "on": 1},
    {"kind": "colour", "by": "smell"}, {"kind": "shown", "frame": 2.5},
]  # fmt: skip


@pytest.mark.parametrize("message", PROPER, ids=lambda m: m["kind"])
def test_a_proper_message_is_read(message: dict[str, Any]) -> None:
    read = read_message(json.dumps(message))
    assert json.loads(read.model_dump_json()) == message


@pytest.mark.parametrize("message", WRONG)
def test_another_message_is_refused(message: Any) -> None:
    with pytest.raises(MessageError, match="no message"):
        read_message(json.dumps(message))


@pytest.mark.parametrize(
    "text", ["", "{", "NaN", "[" * 2000, "{}" + " " * 5000, '{"kind":"reset"}\x00', "\ud800"]
)
def test_what_is_no_json_is_refused(text: str) -> None:
    with pytest.raises(MessageError):
        read_message(text)


def test_bytes_are_refused() -> None:
    with pytest.raises(MessageError, match="is text"):
        read_message(b'{"kind":"reset"}')


def test_a_thousand_malformed_messages_are_each_refused(malformed: list[str | bytes]) -> None:
    for text in malformed:
        with pytest.raises(MessageError):
            read_message(text)


def test_places_keep_their_thousandth_of_a_millimetre_and_stay_in_the_box() -> None:
    points = np.random.default_rng(1).uniform(-40.0, 60.0, (50, 3))
    box = Box(points)
    told = box.described()
    back = np.array(told["origin"]) + told["step"] * box.packed(points)
    assert np.abs(back - points).max() <= 0.51 * told["step"] < 0.01
    outside = box.packed(np.array([[1e9, -1e9, 0.0]]))
    assert outside[0, 0] == 65535
    assert outside[0, 1] == 0


def test_a_frame_comes_back_as_it_was() -> None:
    chance = np.random.default_rng(2)
    numbers = [chance.integers(0, 65536, (7, 3)).astype(np.uint16) for _ in range(2)]
    shades = [chance.integers(0, 256, 7).astype(np.uint8) for _ in range(2)]
    head = {"frame": 5, "panes": [{}, {}]}
    data = pack_frame(head, list(zip(numbers, shades, strict=True)))
    (length,) = np.frombuffer(data[:4], "<u4")
    assert (4 + length) % 8 == 0
    read, positions, colours = unpack_frame(data, 7)
    assert read == head
    np.testing.assert_array_equal(positions, numbers)
    np.testing.assert_array_equal(colours, shades)
