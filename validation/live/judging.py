"""Compares the pose on the page with the reference, in the background.

The same mesh comes first, within seconds; then the truth, within a time limit. Each result is
shown as soon as it is there, and stays.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from palpate.meshes.supervised import supervised
from palpate.reference import availability
from palpate.validation.live.verdict import ASKED, SAME_MESH, TRUTH

Note = dict[str, Any]
VERDICT = "palpate.validation.live.verdict"
# The longest wait for each result, counted from the end of what preceded it [s].
LIMITS = {SAME_MESH: 120.0, TRUTH: 180.0}
_CALLED = {SAME_MESH: "the reference on the same mesh", TRUTH: "the truth"}
# What a line of the solver's means to who waits for it; the words of other lines are their own.
_IN_WORDS = tuple(
    (re.compile(pattern), words)
    for pattern, words in (
        (r"bringing it to rest|looking for its equilibrium", "bringing the bodies to rest"),
        (r"^(loading|compiling|reference )|degrees of freedom", "starting the solver"),
        (r"^from nearby", "looking for the equilibrium near the pose"),
        (r"^load ", "raising the load by steps"),
        (r"^tools? ", "pressing the tool in by small steps"),
        (r"^mesh \d+", "refining the mesh where the error comes from"),
        (r"no equilibrium on", "trying another mesh"),
    )
)
# Why a step of the tool was not taken, which is said where no more comes of it in time.
_BACK = re.compile(r"^tools? .* (?P<part>[0-9.]+): (?P<reason>[^;]+); back to")
# The shortest time between two reports of progress [s].
_BREATH = 0.5


class Judging(threading.Thread):
    """Runs `verdict` for a pose and passes its notes to the page.

    Args:
        case: Written by `recording.write_pose`.
        pose: The file of the pose beside it.
        say: Called with notes for the page.
    """

    def __init__(self, case: Path, pose: Path, say: Callable[[Note], None]) -> None:
        super().__init__(name="judging", daemon=True)
        self._case, self._pose, self._say = case, pose, say
        self._process: subprocess.Popen[Any] | None = None
        self._is_over = self._is_late = False
        self._since, self._obstacle = time.monotonic(), ""
        self._waits_for: str | None = SAME_MESH
        self._timer = threading.Timer(0.0, self._give_up)

    def run(self) -> None:
        """Run the program and pass on its notes."""
        if not availability.is_available():
            self._end(
                "FEniCSx is not installed here, so there is nothing to hold this against; where it "
                f"is: palpate compare {self._case} RESULT --live"
            )
            return
        command = [sys.executable, "-m", VERDICT, str(self._case), str(self._pose)]
        pipe = subprocess.PIPE
        trouble: list[str] = []
        with supervised(
            command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True
        ) as process:
            self._process = process
            assert process.stdout is not None
            assert process.stderr is not None
            errors = process.stderr
            reading = threading.Thread(target=lambda: trouble.extend(errors), daemon=True)
            reading.start()
            self._wait_for(SAME_MESH)
            last = 0.0
            for line in process.stdout:
                if back := _BACK.match(line):
                    part, reason = float(back["part"]), back["reason"]
                    self._obstacle = f"; at {100.0 * part:.0f} % of the tool's way {reason}"
                if line.startswith("{"):
                    self._pass_on(json.loads(line))
                elif time.monotonic() - last > _BREATH:
                    last = time.monotonic()
                    self._progress(line)
            code = process.wait()
            self._timer.cancel()
            reading.join()
            process.stdout.close()
            errors.close()
        if self._is_over or self._waits_for is None:
            return
        if self._is_late:
            limit = LIMITS[self._waits_for]
            called = _CALLED[self._waits_for]
            self._end(f"{called} was not found within {limit:g} s{self._obstacle}{self._stands}")
        else:
            said = trouble[-1].strip() if trouble else f"the solver ended with {code}"
            self._end(f"{_CALLED[self._waits_for]} was not found: {said}{self._stands}")

    @property
    def _stands(self) -> str:
        return "; the verdict on the same mesh stands" if self._waits_for == TRUTH else ""

    def _wait_for(self, question: str | None) -> None:
        """Begin to wait for the result of a question; with None, stop waiting."""
        self._timer.cancel()
        self._waits_for = question
        if question is not None:
            self._since = time.monotonic()
            self._timer = threading.Timer(LIMITS[question], self._give_up)
            self._timer.daemon = True
            self._timer.start()

    def _give_up(self) -> None:
        self._is_late = True
        if self._process is not None:
            self._process.terminate()

    def _pass_on(self, note: Note) -> None:
        """Pass on a note of the program; after the first errors, wait for the truth."""
        if note["kind"] == "judged":
            self._wait_for(TRUTH if note["more"] else None)
        self._say(note)
        if note.get("more"):
            self._progress("looking for the truth")

    def _progress(self, line: str) -> None:
        """Say how far the search has come: in words, and as a part of the longest wait."""
        if self._waits_for is not None:
            share = min(1.0, (time.monotonic() - self._since) / LIMITS[self._waits_for])
            text = f"{ASKED[self._waits_for]} {in_words(line)}"
            self._say({"kind": "progress", "text": text, "share": share})

    def stop(self) -> None:
        """End the thread and the program that it started."""
        self._is_over = True
        self._timer.cancel()
        if self._process is not None:
            self._process.terminate()
        self.join()

    def _end(self, text: str) -> None:
        question = ASKED[self._waits_for or TRUTH]
        self._say({**not_judged(text), "question": question})


def not_judged(text: str) -> Note:
    """The note that nothing was found, with the reason."""
    return {
        "kind": "judged", "text": text, "question": "", "rows": [], "more": False, "verdicts": [],
        "errors": [],
    }  # fmt: skip


def in_words(line: str) -> str:
    """What a line of the solver's means to who waits for it."""
    text = line.strip()
    return next((words for pattern, words in _IN_WORDS if pattern.search(text)), text)
