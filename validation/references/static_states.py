"""A static answer of the reference as a state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.linalg import norm

from palpate.meshes.problem import Strain
from palpate.reference.result import AdaptiveResult, ReferenceResult
from palpate.validation.states import REFERENCE, CellStresses, State


def stresses_of(found: ReferenceResult) -> CellStresses:
    """Its stresses of cells."""
    return CellStresses(
        found.second_piola_kirchhoff_stress,
        found.cauchy_stress,
        found.first_piola_kirchhoff_stress,
    )


def first_state(found: AdaptiveResult, label: str, **rest: Any) -> State:
    """What an adaptive truth, begun from nothing, found on the case's mesh; as `state_of`."""
    assert found.first is not None
    seconds = float(found.seconds[0])
    return state_of(
        found.first, found.first.strain, label=label, degree=found.degree, seconds=seconds, **rest
    )


def state_of(
    found: ReferenceResult, strain: Strain, *, label: str, degree: int, seconds: float, **rest: Any
) -> State:
    """What the reference found, named and timed; `rest` are further fields of the state."""
    return State(
        label=label,
        simulator=REFERENCE,
        strain=strain,
        degree=degree,
        displacement=found.displacement,
        volume=found.volume,
        surface_area=found.surface_area,
        smallest_det_f=found.smallest_det_f,
        max_displacement=float(norm(found.displacement, axis=1).max()),
        seconds=seconds,
        tool_forces=np.array([tool.forces[-1] for tool in found.tools]) if found.tools else None,
        details={
            "relative_residual": found.relative_residual,
            "newton_iterations": found.newton_iterations,
            "formulation": found.formulation.value,
        },
        versions=dict(found.versions),
        **rest,
    )
