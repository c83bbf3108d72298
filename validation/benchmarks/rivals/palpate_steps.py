"""Our own explicit steps as `simulate` does them; its outputs are where others take their turn."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from palpate.fastsim import _core
from palpate.fastsim.dynamics import Precision, simulate
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh


class Rival:
    """The shipped default step, with supports, weight and damping; an output ends each timing."""

    tool, version = "palpate", _core.__version__

    def __init__(self, body: dict[str, Any]) -> None:
        self.precision = str(body["precision"])
        mesh = TetMesh(body["points"], body["cells"])
        material = Material(
            float(body["youngs_modulus"]), float(body["poissons_ratio"]), float(body["density"])
        )
        self.force = None
        steps, rounds = int(body["steps_per_timing"]), int(body["most_timings"])
        dt = float(body["time_step"])
        span = TimeSpan(
            rounds * steps * dt, dt * (1.0 + 1e-9), float(body["mass_damping"]), rounds
        )  # fmt: skip
        x, y, z = map(float, body["force_density"])
        load = BodyForce((x, y, z))
        problem = Problem(mesh, material, (Support(body["held"]),), (load,), span)
        self._go, self._done = threading.Semaphore(0), threading.Semaphore(0)
        self._error: BaseException | None = None

        def at_output(_line: str) -> None:
            self._done.release()
            self._go.acquire()

        def work() -> None:
            try:
                simulate(
                    problem,
                    precision=Precision(self.precision),
                    num_threads=int(body["num_threads"]),
                    progress=at_output,
                )
            except BaseException as error:
                self._error = error
                self._done.release()

        self._steps = steps
        # Ends with the process, wherever it is.
        threading.Thread(target=work, daemon=True).start()
        self._wait()  # for the first output: everything is set up and warm

    def _wait(self) -> None:
        self._done.acquire()
        if self._error is not None:
            raise self._error

    def advance(self, num_steps: int) -> dict[str, Any]:
        """From one output to the next."""
        assert num_steps == self._steps
        self._go.release()
        self._wait()
        return {"instruction_set": _core.widest_instruction_set().name}


def prepare(body: dict[str, Any]) -> Rival:
    """Set up the run."""
    return Rival({k: np.asarray(v) for k, v in body.items()})
