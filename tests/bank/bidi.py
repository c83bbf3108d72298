"""A small client of WebDriver BiDi: Firefox without a driver of its own."""

from __future__ import annotations

import itertools
import json
import os
import re
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# A page draws by software and fetches nothing from outside.
_PREFERENCES = """
user_pref("webgl.force-enabled", true);
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("app.update.enabled", false);
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
"""


class Firefox:
    """One window of Firefox.

    Args:
        socket: Connected to its BiDi address, before a session.
    """

    def __init__(self, socket: Any) -> None:
        self._socket, self._numbers = socket, itertools.count(1)
        self.errors: list[str] = []
        self.ask("session.new", capabilities={})
        self.ask("session.subscribe", events=["log.entryAdded"])
        tree = self.ask("browsingContext.getTree")
        self._context = tree["contexts"][0]["context"]

    def ask(self, method: str, **words: Any) -> dict[str, Any]:
        """Give a command and wait for its result; what the page logs as an error is recorded.

        Raises:
            RuntimeError: The browser refused it.
        """
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": words}))
        while True:
            heard = json.loads(self._socket.recv(timeout=60))
            if heard.get("method") == "log.entryAdded" and heard["params"]["level"] == "error":
                self.errors.append(str(heard["params"]["text"]))
            if heard.get("id") == number:
                if heard["type"] == "error":
                    raise RuntimeError(f"{method}: {heard['message']}")
                result: dict[str, Any] = heard["result"]
                return result

    def open(self, address: str, wide: int, high: int) -> None:
        """Open an address in a window of a size [px]."""
        size = {"width": wide, "height": high}
        self.ask("browsingContext.setViewport", context=self._context, viewport=size)
        self.ask("browsingContext.navigate", context=self._context, url=address, wait="complete")

    def value(self, script: str) -> Any:
        """The value of an expression in the page, by JSON."""
        found = self.ask(
            "script.evaluate",
            expression=f"JSON.stringify({script})",
            target={"context": self._context},
            awaitPromise=False,
        )
        if found["type"] == "exception":
            raise RuntimeError(found["exceptionDetails"]["text"])
        return json.loads(found["result"].get("value", "null"))

    def drag(self, start: tuple[int, int], way: tuple[int, int], parts: int = 8) -> None:
        """Press the mouse at a position [px], move it by a way in some parts, let go."""
        moves = [
            {
                "type": "pointerMove",
                "x": start[0] + way[0] * k // parts,
                "y": start[1] + way[1] * k // parts,
                "duration": 30,
            }
            for k in range(parts + 1)
        ]
        down, up = ({"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp"))
        steps = [moves[0], down, *moves[1:], up]
        mouse = {"type": "pointer", "id": "mouse", "actions": steps}
        self.ask("input.performActions", context=self._context, actions=[mouse])


@contextmanager
def screen() -> Iterator[str]:
    """A screen in memory, on which Mesa draws by software: Firefox has no WebGL without one."""
    with subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "1400x1000x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            yield f":{process.stdout.readline().strip()}"
        finally:
            process.terminate()


@contextmanager
def firefox(program: str, folder: Path) -> Iterator[Firefox]:
    """Firefox on a screen of its own, its profile in a folder; both end with the block."""
    from websockets.sync.client import connect

    profile = folder / "profile"
    profile.mkdir()
    (profile / "user.js").write_text(_PREFERENCES)
    words = [program, "--no-remote", "--profile", str(profile), "--remote-debugging-port", "0"]
    with (
        screen() as display,
        subprocess.Popen(
            [*words, "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1"},
        ) as process,
    ):
        try:
            assert process.stderr is not None
            lines = (re.search(r"BiDi listening on (ws://\S+)", line) for line in process.stderr)
            address = next(found[1] for found in lines if found)
            # What else it writes is read, too, or its pipe would be full some time.
            threading.Thread(target=process.stderr.read, daemon=True).start()
            with connect(f"{address}/session", max_size=None) as socket:
                yield Firefox(socket)
        finally:
            process.kill()
