"""What is seen, stopped and held against the reference in the background.

First on the same mesh, within seconds; then the truth, for so long at most. Whichever there is, is
shown at once and stays.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats, Indices
from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.supervised import supervised
from palpate.meshes.untrusted_text import parse_toml
from palpate.reference import availability
from palpate.validation.live.condensed_pane import AnyPane
from palpate.validation.live.live_case import LiveCase
from palpate.validation.live.recording import write_case
from palpate.validation.live.verdict import ANSWERED, SAME_MESH, TRUTH
from palpate.validation.report.viewer import packed

Note = dict[str, Any]
VERDICT = "palpate.validation.live.verdict"
# Each answer is waited for so long after what was before it [s].
LIMITS = {SAME_MESH: 120.0, TRUTH: 180.0}
_ASKED = {SAME_MESH: "is it solved right?", TRUTH: "is it what tissue does?"}
_CALLED = {SAME_MESH: "the reference on the same mesh", TRUTH: "the truth"}
_COLOUR = {
    SAME_MESH: "colour: distance from the reference on the same mesh",
    TRUTH: "colour: distance from the truth (P2, Green strain)",
}
# Progress is told so often at most [s].
_BREATH = 0.5
# Of the truth: a fifth of the smallest limit below.
_BAR = 0.01
# Less than this part of the body's size is no displacement worth a verdict.
_NOTHING = 1e-6
_CHECKS: list[dict[str, Any]] = [
    {
        "metric": "displacement_l2",
        "against": "truth",
        "limit": 0.05,
        "reason": "a twentieth of the displacement: of 16 mm, an instrument is placed to one",
    },
    {
        "metric": "smallest_det_f",
        "against": "candidate",
        "limit": 0.0,
        "reason": "no cell may be inverted",
    },
]
_FORCE_CHECK = {
    "metric": "tool_force",
    "against": "truth",
    "limit": 0.07,
    "reason": "a hand tells forces that differ by 7 to 10 % (L. A. Jones, Perception 18, 1989)",
}


def write_pose(
    live: LiveCase,
    place: Floats,
    panes: Sequence[AnyPane],
    forces: Sequence[Floats],
    grip: dict[str, Any] | None,
    folder: Path,
    name: str,
) -> tuple[Path, Path]:
    """Write what is seen as a static case, with the answers of the panes beside it.

    Args:
        live: What is touched.
        place: Of the tool, in the case's unit, shape (3,).
        panes: As they stand.
        forces: On the tool [N], shape (3,) for each pane.
        grip: Table of a spring that holds the surface.
        folder: Made where it is not there.
        name: Of the case.

    Returns:
        The case file, and the .npz with displacements, forces, names and elements.

    Raises:
        InputError: Nothing acts on the body.
    """
    mesh = live.problem.mesh
    size = float(np.ptp(mesh.points, axis=0).max())
    moved = [np.array(pane.body.displacement) for pane in panes]
    if max(float(np.abs(u).max()) for u in moved) < _NOTHING * size:
        raise InputError("nothing acts on the body: press it first, and hold still")
    data = live.with_path([place])
    data.pop("time")
    data["strain"] = "green"
    data["title"] = f"{live.case.title}: held in a hand"
    data.pop("load", None)
    given = parse_toml(live.case.text).get("load")
    if live.has_loads and given:
        data["load"] = given
    data.pop("spring", None)
    springs = parse_toml(live.case.text).get("spring", []) if live.has_loads else []
    if grip is not None:
        springs = [*springs, grip]
    if springs:
        data["spring"] = springs
    data["check"] = list(_CHECKS)
    data["truth"] = {"bar": _BAR}
    if any(np.any(force) for force in forces):
        # From outside straight to where it is: without friction the way does not matter.
        out = max(0.0, float((live.start - place) @ live.outwards))
        pose = data["tool"][0]["pose"][0]
        data["tool"][0]["pose"] = [
            {**pose, "time": 0.0, "position": (place + out * live.outwards).tolist()},
            {**pose, "time": 1.0, "position": place.tolist()},
        ]
        data["check"].insert(1, _FORCE_CHECK)
    else:
        data.pop("tool")
    path = write_case(live.case, data, folder, name)
    answers = folder / f"{name}.npz"
    with atomic_path(answers) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            displacement=np.array(moved),
            force=np.array(forces),
            names=np.array([pane.name for pane in panes]),
            strain=np.array([pane.strain.value for pane in panes]),
            element=np.array([pane.element.value for pane in panes]),
        )
    return path, answers


class Judging(threading.Thread):
    """Runs `verdict` for a pose and says what comes of it.

    Args:
        case: Written by `write_pose`.
        answers: Beside it.
        used: The points whose errors the page shows.
        say: Takes notes for the page.
    """

    def __init__(
        self, case: Path, answers: Path, used: Indices, say: Callable[[Note], None]
    ) -> None:
        super().__init__(name="judging", daemon=True)
        self._case, self._answers, self._used, self._say = case, answers, used, say
        self._process: subprocess.Popen[Any] | None = None
        self._is_over = self._is_late = False
        self._waits_for: str | None = SAME_MESH
        self._timer = threading.Timer(0.0, self._give_up)

    def run(self) -> None:
        """The thread."""
        if not availability.is_available():
            self._end(
                "FEniCSx is not installed here, so there is nothing to hold this against; where it "
                f"is: palpate compare {self._case} RESULT --live"
            )
            return
        found = self._answers.with_name(f"{self._case.stem}-errors.npz")
        command = [sys.executable, "-m", VERDICT, *map(str, (self._case, self._answers, found))]
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
                if line.startswith(ANSWERED):
                    self._tell(line.removeprefix(ANSWERED).strip(), found)
                elif time.monotonic() - last > _BREATH:
                    last = time.monotonic()
                    self._say({"kind": "progress", "text": line.strip()})
            code = process.wait()
            self._timer.cancel()
            reading.join()
            process.stdout.close()
            errors.close()
        if self._is_over or self._waits_for is None:
            return
        if self._is_late:
            limit = LIMITS[self._waits_for]
            self._end(f"{_CALLED[self._waits_for]} was not found within {limit:g} s{self._kept}")
        else:
            said = trouble[-1].strip() if trouble else f"the solver ended with {code}"
            self._end(f"{_CALLED[self._waits_for]} was not found: {said}{self._kept}")

    @property
    def _kept(self) -> str:
        return "; the verdict on the same mesh stands" if self._waits_for == TRUTH else ""

    def _wait_for(self, question: str | None) -> None:
        """Begin to wait for the answer to a question; for nothing more where None."""
        self._timer.cancel()
        self._waits_for = question
        if question is not None:
            self._timer = threading.Timer(LIMITS[question], self._give_up)
            self._timer.daemon = True
            self._timer.start()

    def _give_up(self) -> None:
        self._is_late = True
        if self._process is not None:
            self._process.terminate()

    def _tell(self, question: str, found: Path) -> None:
        """Show an answer."""
        self._wait_for(TRUTH if question == SAME_MESH else None)
        with np.load(found, allow_pickle=False) as data:
            lengths = data["errors"][:, self._used] * 1e3
            told = json.loads(str(data["told"]))
        for pane in told:
            checks = "; ".join(pane["checks"])
            self._say(
                {
                    "kind": "note",
                    "text": f"{_ASKED[question]} {pane['name']}: {pane['verdict']}. {checks}",
                    "verdict": pane["verdict"],
                }
            )
        there = np.isfinite(lengths).all(axis=1)
        self._say(
            {
                "kind": "judged",
                "text": f"{_COLOUR[question]}; the case: {self._case}",
                "against": question,
                "more": self._waits_for is not None,
                "verdicts": [pane["verdict"] for pane in told],
                "largest": float(lengths[there].max(initial=0.0)),
                "errors": [
                    packed(of, np.float32) if is_there else None
                    for of, is_there in zip(lengths, there, strict=True)
                ],
            }
        )
        if self._waits_for is not None:
            limit = LIMITS[self._waits_for]
            self._say({"kind": "progress", "text": f"looking for the truth, {limit:g} s at most"})

    def stop(self) -> None:
        """End it, with what it started."""
        self._is_over = True
        self._timer.cancel()
        if self._process is not None:
            self._process.terminate()
        self.join()

    def _end(self, text: str) -> None:
        self._say({"kind": "judged", "text": text, "more": False, "verdicts": [], "errors": []})
