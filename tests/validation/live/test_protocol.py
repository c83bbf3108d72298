"""Messages of the page and frames to it: strict, small, and nothing in them does harm."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from palpate.validation.live.frames import Box, pack_frame, unpack_frame
from palpate.validation.live.protocol import MessageError, read_message


def test_a_proper_message_is_read(proper: dict[str, Any]) -> None:
    read = read_message(json.dumps(proper))
    assert json.loads(read.model_dump_json()) == proper


def test_a_thousand_malformed_messages_are_each_refused(malformed: list[str | bytes]) -> None:
    assert len(set(malformed)) >= 1000
    for text in malformed:
        with pytest.raises(MessageError, match=r"is text|no message"):
            read_message(text)
    with pytest.raises(MessageError, match="no message"):
        read_message("\ud800")
    with pytest.raises(MessageError, match="at most 2048 characters"):
        read_message("{}" + " " * 5000)


def test_positions_keep_their_thousandth_of_a_millimetre_and_stay_in_the_box() -> None:
    points = np.random.default_rng(1).uniform(-40.0, 60.0, (50, 3))
    box = Box(points)
    box_of = box.described()
    back = np.array(box_of["origin"]) + box_of["step"] * box.packed(points)
    assert np.abs(back - points).max() <= 0.51 * box_of["step"] < 0.01
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
