"""Our own explicit steps, on the body that `simulate` makes and with the energies it adds up."""

from __future__ import annotations

from typing import Any

from palpate.fastsim import _core
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Material, Problem, TimeSpan
from palpate.meshes.tet_mesh import TetMesh


class Rival:
    """The shipped default step, with supports, weight and damping; one output a timing."""

    tool, version, force = "palpate", _core.__version__, None

    def __init__(self, body: dict[str, Any]) -> None:
        self.precision = str(body["precision"])
        material = Material(
            float(body["youngs_modulus"]), float(body["poissons_ratio"]), float(body["density"])
        )
        x, y, z = map(float, body["force_density"])
        problem = Problem(
            TetMesh(body["points"], body["cells"]),
            material,
            (Support(body["held"]),),
            (BodyForce((x, y, z)),),
            TimeSpan(1.0, mass_damping=float(body["mass_damping"])),
        )
        self._body = ExplicitBody(
            problem,
            time_step=float(body["time_step"]),
            precision=Precision(self.precision),
            num_threads=int(body["num_threads"]),
        )

    def advance(self, num_steps: int) -> dict[str, Any]:
        """From one output to the next."""
        self._body.step(num_steps)
        self._body.look()
        self._last = self._body.displacement
        return {"instruction_set": self._body.instruction_set}


def prepare(body: dict[str, Any]) -> Rival:
    """Set up the run."""
    return Rival(body)
