"""A body with inclusions is refused by every solver, never solved as if it had none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.fastsim.dynamic_relaxation import relax
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import SeveralMaterialsError
from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.rigid_tool import PlaneShape, RigidTool, ToolPath
from palpate.meshes.tet_mesh import TetMesh


@pytest.mark.parametrize("solve", [solve_static, simulate, relax])
@pytest.mark.parametrize("has_tool", [False, True])
def test_inclusions_are_refused(
    ragged_box: TetMesh, solve: Callable[[Problem], object], has_tool: bool
) -> None:
    held = np.flatnonzero(ragged_box.points[:, 0] == 0.0).astype(np.int32)
    inclusion = Inclusion(np.arange(3, dtype=np.int32), Material(1e5, 0.3))
    above = RigidTool(PlaneShape(), ToolPath([0.0], [[0.0, 0.0, -5.0]]))
    problem = Problem(
        ragged_box, Material(1e4, 0.3), (Support(held),), (BodyForce((0.0, 0.0, -1.0)),),
        TimeSpan(0.01, num_outputs=1), tools=(above,) if has_tool else (),
        inclusions=(inclusion,),
    )  # fmt: skip
    with pytest.raises(SeveralMaterialsError, match="of 3 cells") as caught:
        solve(problem)
    assert (caught.value.num_inclusions, caught.value.num_cells) == (1, 3)
