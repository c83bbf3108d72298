"""The adaptive truth under mpirun: the same meshes, states and bars, by as many iterations."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.problem import Inclusion, Material, Problem
from palpate.meshes.problem_files import save_problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath

pytestmark = pytest.mark.dolfinx

# A plain one, and once more by ranks that mishear each other; or a mixed one with a tool and an
# inclusion.
SOLVES = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference import fenicsx, mesh_transfer
from palpate.reference.adaptivity.adaptive import solve_adaptively
from palpate.reference.adaptivity.goals import Budget, Goal, Quantity
from palpate.reference.fenicsx import COMM
from palpate.reference.result import Formulation

MIXED, PLAIN = Formulation.MIXED, Formulation.DISPLACEMENT
L2 = Quantity.DISPLACEMENT_L2
pulled = {L2: 0.1, Quantity.SURFACE_AREA: 0.2, Quantity.DISPLACEMENT_MAX: 0.2}
pressed = {L2: 0.2, Quantity.TOOL_FORCE: 0.5}

def misheard(parts):
    heard = fenicsx.exchange(parts)
    return [
        0.9 * x if isinstance(x, np.ndarray) and rank != COMM.rank else x
        for rank, x in enumerate(heard)
    ]

runs = {
    "pulled": [("pulled", pulled, PLAIN), ("misheard", pulled, PLAIN)],
    "pressed": [("pressed", pressed, MIXED)],
}
file, most = sys.argv[2], 1e9
for name, goals, formulation in runs[file][: COMM.size]:
    if name == "misheard":
        mesh_transfer.exchange = misheard
    lines = []
    found = solve_adaptively(
        load_problem(f"{sys.argv[1]}/{file}.npz"),
        [Goal(quantity, bar) for quantity, bar in goals.items()],
        formulation=formulation,
        budget=Budget(unknowns=most),
        progress=lines.append,
    )
    ends = [k for k, line in enumerate(lines) if line.startswith("mesh ")] + [None]
    if len(found.num_unknowns) > 1:
        most = 2.5 * found.num_unknowns[1]  # two meshes for the next
    if COMM.rank == 0:
        np.savez(
            f"{sys.argv[1]}/{name}-{COMM.size}.npz",
            displacement=found.displacement,
            stress=found.cauchy_stress,
            pushes=found.support_forces,
            felt=[tool.forces[-1] for tool in found.tools] or np.ones(1),
            bars=found.bars[2:],
            estimates=found.estimates,
            unknowns=found.num_unknowns,
            # A line for each iteration, on the first mesh from nothing.
            first=sum(line.startswith("load") for line in lines),
            second=sum(line.startswith("from nearby") for line in lines[ends[0] : ends[1]]),
            all=sum(line.startswith("from nearby") for line in lines),
        )
"""

# Of the largest: Newton ends at 1e-10, tools' forces at 1e-9; estimates are of duals to 1e-3.
APART = {
    "displacement": 1e-8, "stress": 1e-7, "pushes": 1e-7, "felt": 1e-7,
    "bars": 1e-4, "estimates": 1e-4,
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("pulled", ("unknowns", "first", "second", "all")),
        # Multipliers are taken from the nearest point: of several as near, from the first one in
        # the order of the ranks, so that iterations with a tool are not the same.
        pytest.param("pressed", ("unknowns", "first"), marks=pytest.mark.nightly),
    ],
)
def test_two_ranks_refine_as_one_does_and_go_on_from_mesh_to_mesh(
    mpirun, tmp_path, box, name, counts
):
    mesh = box((2, 1, 1), (0.2, 0.1, 0.1))
    held = mesh.facet_groups["x0"]
    support = Support(np.unique(held).astype(np.int32), held)
    pull = Traction(mesh.facet_groups["x1"], (300.0, 0.0, -200.0))
    half = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.1).astype(np.int32)
    places = np.array([[0.13, 0.06, 0.16], [0.13, 0.06, 0.13]])
    tool = RigidTool(SphereShape(0.06), ToolPath(np.arange(2.0), places))
    problem = Problem(mesh, Material(2e4, 0.3), (support,), (pull,))
    if name == "pressed":
        inside = Inclusion(half, Material(6e4, 0.495))
        stiff = Material(2e4, 0.499)
        problem = Problem(mesh, stiff, (support,), (pull,), inclusions=(inside,), tools=(tool,))
    save_problem(tmp_path / f"{name}.npz", problem)
    for n in (1, 2):
        done = mpirun(n, "-c", SOLVES, str(tmp_path), name)
        assert done.returncode == 0, done.stderr
    alone, both = (dict(np.load(tmp_path / f"{name}-{n}.npz")) for n in (1, 2))
    assert len(alone["unknowns"]) > 2
    assert min(alone["second"], both["second"]) > 1
    assert np.abs(alone["felt"]).max() > 1e-3
    for key in counts:
        assert np.array_equal(both[key], alone[key]), (key, alone[key], both[key])
    for key, apart in APART.items():
        finite = np.isfinite(alone[key])
        assert finite.any()
        scale = np.abs(alone[key][finite]).max()
        np.testing.assert_allclose(
            both[key], alone[key], rtol=apart, atol=apart * scale, err_msg=key
        )
    if name == "pulled":
        assert np.load(tmp_path / "misheard-2.npz")["second"] > both["second"]
