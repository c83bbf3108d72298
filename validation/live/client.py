"""A page without a browser: sends a hand and reads frames. For tests and timings."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.live.frames import unpack_frame

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

# No frame for so long is an error [s].
_PATIENCE = 30.0


class Client:
    """One end of the socket.

    Attributes:
        scene: What the server said first.
        frames: Heads of all frames.
        sizes: Their sizes [bytes].
        notes: All notes.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.frames: list[dict[str, Any]] = []
        self.sizes: list[int] = []
        self.notes: list[dict[str, Any]] = []
        self.scene = self._note(socket.recv(_PATIENCE))
        self._last = b""

    def say(self, kind: str, **message: Any) -> None:
        """Send a message of the page."""
        self.socket.send(json.dumps({"kind": kind, **message}))

    def hear(self) -> dict[str, Any]:
        """The head of the next frame, which is confirmed, or the next note."""
        news = self.socket.recv(_PATIENCE)
        if isinstance(news, str):
            self.notes.append(self._note(news))
            return self.notes[-1]
        length = int.from_bytes(news[:4], "little")
        head: dict[str, Any] = json.loads(news[4 : 4 + length])
        self.say("shown", frame=head["frame"])
        self._last = news
        self.frames.append(head)
        self.sizes.append(len(news))
        return head

    def until(self, is_so: Callable[[dict[str, Any]], bool], most: int = 10_000) -> dict[str, Any]:
        """The first head or note that is so.

        Raises:
            TimeoutError: None of so many, or nothing comes.
        """
        for _ in range(most):
            heard = self.hear()
            if is_so(heard):
                return heard
        raise TimeoutError(f"none of {most} frames and notes")

    def until_time(self, seconds: float) -> dict[str, Any]:
        """The first frame at a time of the bodies [s] or later."""
        return self.until(lambda heard: heard.get("time", -1.0) >= seconds)

    def positions(self, num_points: int) -> list[Points]:
        """Of the surface's points in the last frame [mm], (num_points, 3) for each pane."""
        _, numbers, _ = unpack_frame(self._last, num_points)
        box = self.scene["box"]
        return [box["step"] * of + np.array(box["origin"]) for of in numbers]

    @staticmethod
    def _note(text: str | bytes) -> dict[str, Any]:
        note: dict[str, Any] = json.loads(text)
        return note


@contextmanager
def connected(address: str, **changed: Any) -> Iterator[Client]:
    """A client of a page's address; see `websockets.sync.client.connect` for what may change."""
    from websockets.sync.client import connect

    options = {"origin": address.rsplit("/", 2)[0], "max_size": None, "compression": None}
    with connect(address.replace("http", "ws", 1) + "socket", **(options | changed)) as socket:
        yield Client(socket)
