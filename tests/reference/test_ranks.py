"""Solves on several ranks of mpirun, adaptive ones too: the same as on one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from bank import support

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.files import read_result_arrays
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.problem_files import save_problem
from palpate.meshes.rigid_tool import BoxShape, ForceDrive, RigidTool, SphereShape, ToolPath
from palpate.meshes.transforms import rotation, turn
from palpate.reference import ranks

pytestmark = pytest.mark.dolfinx

EXAMPLE = Path(__file__).parents[2] / "validation" / "examples" / "gate_your_simulator"
# Every rank does this: solves by factors or multigrid, and an audit of the first of them.
SOLVES = """
import json
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference import linear_solver
from palpate.reference.audit import audit_displacement
from palpate.reference.fenicsx import COMM
from palpate.reference.statics import solve_static

problem, found = load_problem(sys.argv[1]), {}
for name, options in json.loads(sys.argv[2]).items():
    linear_solver.LARGEST_DIRECT = 0 if "multigrid" in name else 10**6
    result = solve_static(problem, **options)
    found[name] = result.displacement
    found[name + "-stress"] = result.cauchy_stress
    found[name + "-support"] = result.support_forces
    found[name + "-scalars"] = np.array(
        [result.volume, result.surface_area, result.smallest_det_f, result.strain_energy]
    )
    if result.tools:
        found[name + "-tool"] = np.array(result.tools[0].forces[-1] + result.tools[0].moments[-1])
if "1-factors" in found:
    audit = audit_displacement(problem, found["1-factors"], degree=2)
    found["audit-multigrid-scalars"] = np.array(
        [audit.residual_norm, audit.displacement_error, audit.volume_error, *audit.cell_errors]
    )
if COMM.rank == 0:
    np.savez(sys.argv[3], size=COMM.size, **found)
"""


def long_box(box):
    return box((5, 2, 2), (0.5, 0.2, 0.2), jitter=0.2)


def pushed(box):
    """Every load, by both degrees, factors and multigrid."""
    mesh, quadratic = long_box(box), {"degree": 2}
    loads = (
        BodyForce((0.0, 200.0, -600.0)),
        Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
        PointForce(np.array([mesh.num_points - 1], np.int32), np.array([[0.0, 0.3, 0.0]])),
        Pressure(mesh.facet_groups["z1"], 80.0),
    )
    solves = {"1-factors": {}, "2-factors": quadratic, "2-multigrid": quadratic}
    return Problem(mesh, Material(2e4, 0.4), (support(mesh, "x0"),), loads), solves


def sliding(box):
    """Along walls at any angle."""
    mesh = long_box(box)
    walls = tuple(
        Support([0], mesh.facet_groups[name], normal=normal)
        for name, normal in zip(("x0", "y0", "z0"), np.eye(3).tolist(), strict=True)
    )
    straight = Problem(mesh, Material(2e4, 0.4), walls, (BodyForce((900.0, 0.0, 0.0)),))
    return turn(straight, rotation((1.0, 2.0, 3.0), 40.0))[0], {"factors": {"degree": 2}}


def twisted(box):
    mesh = long_box(box)
    end = mesh.facet_groups["x1"]
    spin = Rotation((1.0, 0.0, 0.0), (0.5, 0.1, 0.1), 0.5)
    turned = Support([int(end[0, 0])], end, displacement=(0.02, 0.0, 0.0), rotation=spin)
    clamp = Support([0], mesh.facet_groups["x0"])
    load = BodyForce((900.0, 0.0, 0.0))
    return Problem(mesh, Material(2e4, 0.4), (clamp, turned), (load,)), {"factors": {"degree": 2}}


def layered(box):
    """The mixed form of two materials, with a tool and a pressure."""
    mesh = box((4, 2, 2), (1.0, 0.5, 0.5), jitter=0.2)
    half = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(np.int32)
    knots = np.array([[0.4, 0.25, 0.8], [0.4, 0.25, 0.76]])
    problem = Problem(
        mesh,
        Material(2e4, 0.499),
        (support(mesh, "z0"),),
        (Pressure(mesh.facet_groups["x1"], 300.0),),
        inclusions=(Inclusion(half, Material(6e4, 0.495)),),
        tools=(RigidTool(SphereShape(0.3), ToolPath(np.arange(2.0), knots)),),
    )
    return problem, {"factors": {"degree": 2, "formulation": "mixed"}}


@pytest.mark.parametrize(
    ("body", "apart"),
    # The tool's force is settled to 1e-9.
    [(pushed, 1e-10), (sliding, 1e-10), (twisted, 1e-10), (layered, 3e-9)],
)
def test_two_ranks_find_what_one_finds(on_one_and_two, tmp_path, box, body, apart):
    problem, solves = body(box)
    save_problem(tmp_path / "problem.npz", problem)
    alone, both = on_one_and_two(SOLVES, str(tmp_path / "problem.npz"), json.dumps(solves))
    assert alone.keys() == both.keys()
    for name, expected in alone.items():
        # Factors agree to rounding; iterations end at 1e-10 (Newton) and 1e-8 (audit).
        near = 1e-8 if "multigrid" in name else apart
        assert np.abs(expected).max() > 1e-3
        assert np.abs(both[name] - expected).max() < near * np.abs(expected).max(), name


# Cells of another rank at an edge would be missing from its average. The rest is decided by all
# ranks together, or one would wait for the other: where a run leaves the finite numbers, how far a
# tool that misses the body may go, whether one is in the body at the start, and what tools feel.
STEPS = """
import sys
import numpy as np
from palpate.meshes.errors import InputError
from palpate.meshes.problem_files import load_problem
from palpate.reference.errors import ReferenceBlowUpError, ReferenceNotConvergedError
from palpate.reference.stepping import simulate_explicit
from palpate.reference.fenicsx import COMM
from palpate.reference.statics import solve_static

load = lambda name: load_problem(f"{sys.argv[1]}/{name}.npz")
found = {}
for solve in (solve_static, simulate_explicit):
    try:
        solve(load("hit"), element="smoothed")
    except InputError as error:
        found[solve.__name__] = str(error)
for name, solve, kind in (
    ("fast", simulate_explicit, ReferenceBlowUpError),
    ("missed", solve_static, ReferenceNotConvergedError),
    ("inside", simulate_explicit, InputError),
):
    try:
        solve(load(name))
    except kind as error:
        found[name] = getattr(error, "reason", str(error))
hit = simulate_explicit(load("hit"))
if COMM.rank == 0:
    np.savez(sys.argv[2], size=COMM.size, u=hit.displacements, felt=hit.tool_forces, **found)
"""


@pytest.mark.long
def test_steps_tools_and_refusals_are_the_same_on_two_ranks(on_one_and_two, tmp_path, box):
    mesh = box((4, 1, 1), (0.4, 0.1, 0.1))

    def save(name, shape, positions, time=None, drive=None):
        path = ToolPath(
            np.linspace(0.0, time.end_time, len(positions)) if time else [0.0], positions
        )
        tool = RigidTool(shape, path, drive=drive)
        fixed = (support(mesh, "z0"),)
        problem = Problem(mesh, Material(1e4, 0.3, 1e3), fixed, (), time, tools=(tool,))
        save_problem(tmp_path / f"{name}.npz", problem)

    # Over the whole of the top, over one end of it, and far to a side.
    plate, ball = BoxShape((0.3, 0.3, 0.02)), SphereShape(0.05)
    down = [[0.2, 0.05, 0.121], [0.2, 0.05, 0.115]]
    save("hit", plate, down, TimeSpan(0.06, 1e-3, 0.0, 2))
    save("fast", plate, down, TimeSpan(40.0, 0.1, 0.0, 1))
    save("inside", ball, [[0.42, 0.02, 0.13]], TimeSpan(1e-3, 1e-3, 0.0, 1))
    drive = ForceDrive((0.0, 0.0, -1.0), 1.0, TabularAmplitude((0.0,), (1.0,)), 1.0)
    save("missed", ball, [[0.6, 0.05, 0.2]], drive=drive)
    alone, both = on_one_and_two(STEPS, str(tmp_path))
    refused = "smoothed tetrahedra run on one rank; leave mpirun out"
    for name in ("solve_static", "simulate_explicit"):
        assert refused in str(both.pop(name))
        assert name not in alone
    for name in ("fast", "missed", "inside"):
        assert str(alone.pop(name)) == str(both.pop(name))
    assert np.abs(alone["felt"]).max() > 0.1
    for name, values in alone.items():
        assert np.abs(both[name] - values).max() < 1e-10 * np.abs(values).max(), name


MASSES = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference.dynamics import simulate_implicit
from palpate.reference.fenicsx import COMM
from palpate.reference.stepping import simulate_explicit

problem = load_problem(sys.argv[1])
explicit, implicit = simulate_explicit(problem), simulate_implicit(problem, degree=2)
if COMM.rank == 0:
    np.savez(
        sys.argv[2],
        size=COMM.size,
        explicit=explicit.displacements,
        implicit=implicit.displacements,
        kinetic=implicit.kinetic_energies,
    )
"""


@pytest.mark.long
def test_masses_on_the_surface_move_the_same_on_two_ranks(on_one_and_two, tmp_path, box):
    mesh = long_box(box)
    masses = (
        PointMass(mesh.facet_groups["x1"], 6.0),
        PointMass(np.vstack([mesh.facet_groups["z1"], mesh.facet_groups["x1"]]), 4.0),
    )
    weights = tuple(mass.weight(mesh.points, (0.0, 0.0, -2.0)) for mass in masses)
    fixed, time = (support(mesh, "x0"),), TimeSpan(0.05, 1e-3, num_outputs=2)
    problem = Problem(mesh, Material(2e4, 0.4, 1e3), fixed, weights, time, masses=masses)
    save_problem(tmp_path / "problem.npz", problem)
    alone, both = on_one_and_two(MASSES, str(tmp_path / "problem.npz"))
    for name, values in alone.items():
        assert np.abs(values).max() > 1e-4
        assert np.abs(both[name] - values).max() < 1e-9 * np.abs(values).max(), name


@pytest.mark.long
def test_the_command_solves_on_two_ranks_and_writes_once(mpirun, tmp_path):
    path = tmp_path / "kidney.vtu"
    command = ("-m", "palpate.validation.cli", "solve", "kidney", "--with", "reference")
    done = mpirun(2, *command, "-o", str(path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("displacement [m]") == 1
    assert np.abs(read_result_arrays(path)[2]["displacement"]).max() > 1e-3


@pytest.mark.nightly  # every collective call waits for the slower rank, and there are thousands
def test_references_are_built_on_two_ranks_and_are_those_of_one(mpirun, tmp_path):
    built = []
    for n in (1, 2):
        case = shutil.copytree(EXAMPLE, tmp_path / str(n)) / "bar.toml"
        # No memory for a second mesh: the truth's own refinement has a test of its own.
        case.write_text(case.read_text() + "\n[truth]\nmemory = 1e-6\n")
        done = mpirun(n, "-m", "palpate.validation.cli", "reference", "build", str(case))
        assert done.returncode == 0, done.stderr
        with np.load(case.parent / "references" / "bar.pending.npz") as stored:
            states = json.loads(str(stored["header"]))["states"]
            built.append([(s, stored[f"displacement_{k}"]) for k, s in enumerate(states)])
    labels = [(state["label"], state["strain"]) for state, _ in built[0]]
    assert len(set(labels)) == len(labels) == 7  # the last: refined, under the strain of the checks
    assert labels == [(state["label"], state["strain"]) for state, _ in built[1]]
    for (alone, moved), (both, also_moved) in zip(*built, strict=True):
        assert np.abs(moved).max() > 1e-3
        assert np.abs(also_moved - moved).max() < 1e-9 * np.abs(moved).max(), alone["label"]
        for name in ("volume", "surface_area", "smallest_det_f", "max_displacement"):
            assert both[name] == pytest.approx(alone[name], rel=1e-9), alone["label"]


@pytest.mark.long
def test_what_ranks_cannot_share_rank_0_has_solved_apart(mpirun, tmp_path):
    found = []
    for n in (1, 2):
        path = tmp_path / f"{n}.vtu"
        case = ("solve", str(EXAMPLE / "bar.toml"), "--with", "reference", "-o", str(path))
        done = mpirun(n, "-m", "palpate.validation.cli", *case, "--element", "smoothed")
        assert done.returncode == 0, done.stderr
        found.append(read_result_arrays(path)[2]["displacement"])
    assert np.abs(found[0]).max() > 1e-4
    assert np.array_equal(*found)


def test_an_error_is_told_once_with_its_exit_code(mpirun):
    done = mpirun(
        2,
        *("-m", "palpate.validation.cli", "solve", "no-such-case"),
        *("--with", "reference", "-o", "never.vtu"),
    )
    assert done.returncode == 2
    assert done.stderr.count("no built-in case") == 1


def test_without_mpirun_this_process_leads_alone(monkeypatch):
    for name in ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK", "PMI_SIZE", "PMI_RANK"):
        monkeypatch.delenv(name, raising=False)
    assert ranks.num_ranks() == 1
    assert not ranks.is_follower()
    ranks.dismiss(0)


def test_both_mpis_tell_a_process_its_place(monkeypatch):
    for size, rank in (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK")):
        with monkeypatch.context() as patch:
            patch.setenv(size, "4")
            patch.setenv(rank, "3")
            assert ranks.num_ranks() == 4
            assert ranks.is_follower()


# A plain one, and once more by ranks that mishear each other; or a mixed one with a tool and an
# inclusion.
ADAPTIVE_SOLVES = """
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
@pytest.mark.long
def test_two_ranks_refine_as_one_does_and_go_on_from_mesh_to_mesh(
    mpirun, tmp_path, box, name, counts
):
    mesh = box((2, 1, 1), (0.2, 0.1, 0.1))
    pull = Traction(mesh.facet_groups["x1"], (300.0, 0.0, -200.0))
    half = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.1).astype(np.int32)
    positions = np.array([[0.13, 0.06, 0.16], [0.13, 0.06, 0.13]])
    tool = RigidTool(SphereShape(0.06), ToolPath(np.arange(2.0), positions))
    problem = Problem(mesh, Material(2e4, 0.3), (support(mesh, "x0"),), (pull,))
    if name == "pressed":
        inside = Inclusion(half, Material(6e4, 0.495))
        stiff = Material(2e4, 0.499)
        problem = Problem(
            mesh, stiff, (support(mesh, "x0"),), (pull,), inclusions=(inside,), tools=(tool,)
        )
    save_problem(tmp_path / f"{name}.npz", problem)
    for n in (1, 2):
        done = mpirun(n, "-c", ADAPTIVE_SOLVES, str(tmp_path), name)
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
