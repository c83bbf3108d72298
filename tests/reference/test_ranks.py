"""The same command under mpirun: rank 0 leads, and the answer does not depend on how many."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Rotation,
    Support,
    Traction,
)
from palpate.meshes.files import read_answer
from palpate.meshes.problem import Inclusion, Material, Problem, TimeSpan
from palpate.meshes.problem_files import save_problem
from palpate.meshes.rigid_tool import RigidTool, SphereShape, ToolPath
from palpate.meshes.transforms import rotation, turn
from palpate.reference import ranks

_BESIDE = Path(sys.executable).parent / "mpirun"  # the PyPI wheel brings its own
MPIRUN = str(_BESIDE) if _BESIDE.exists() else shutil.which("mpirun")

EXAMPLE = Path(__file__).parents[2] / "validation" / "examples" / "gate_your_simulator"

pytestmark = [
    pytest.mark.dolfinx,
    pytest.mark.skipif(MPIRUN is None, reason="mpirun is not on the path"),
]


def run(num_ranks, *arguments):
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(str(Path(p).absolute()) for p in sys.path if p),
        "OMP_NUM_THREADS": "1",
        # A test machine may have one core, and run as root. With two, whoever yields while it
        # waits loses its core to another process for a whole slice, at each of thousands of calls.
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_mpi_yield_when_idle": str(int(os.cpu_count() == 1)),
    }
    return subprocess.run(
        [
            *([MPIRUN, "-n", str(num_ranks)] if num_ranks > 1 else []),
            *(sys.executable, "-P", *arguments),
        ],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


# Every rank does this: both degrees, factors and multigrid, a follower load, and an audit.
SOLVES = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference import linear_solver
from palpate.reference.audit import audit_displacement
from palpate.reference.fenicsx import COMM
from palpate.reference.statics import solve_static

problem = load_problem(sys.argv[1])
found = {}
for degree, largest in ((1, 10**6), (2, 10**6), (2, 0)):
    linear_solver.LARGEST_DIRECT = largest
    result = solve_static(problem, degree=degree)
    name = f"{degree}-{'factors' if largest else 'multigrid'}"
    found[name] = result.displacement
    found[name + "-stress"] = result.cauchy_stress
    found[name + "-support"] = result.support_forces
    found[name + "-scalars"] = np.array(
        [result.volume, result.surface_area, result.smallest_det_f, result.strain_energy]
    )
audit = audit_displacement(problem, found["1-factors"], degree=2)
found["audit-multigrid-scalars"] = np.array(
    [audit.residual_norm, audit.displacement_error, audit.volume_error, *audit.cell_errors]
)
if COMM.rank == 0:
    np.savez(sys.argv[2], size=COMM.size, **found)
"""


def test_two_ranks_find_what_one_finds(tmp_path, box):
    mesh = box((5, 2, 2), (0.5, 0.2, 0.2), jitter=0.2)
    held = mesh.facet_groups["x0"]
    problem = Problem(
        mesh,
        Material(2e4, 0.4),
        (Support(np.unique(held).astype(np.int32), held),),
        (
            BodyForce((0.0, 200.0, -600.0)),
            Traction(mesh.facet_groups["x1"], (30.0, 0.0, 10.0)),
            PointForce(np.array([mesh.num_points - 1], np.int32), np.array([[0.0, 0.3, 0.0]])),
            Pressure(mesh.facet_groups["z1"], 80.0),
        ),
    )
    save_problem(tmp_path / "problem.npz", problem)
    found = {}
    for n in (1, 2):
        path = tmp_path / f"{n}.npz"
        done = run(n, "-c", SOLVES, str(tmp_path / "problem.npz"), str(path))
        assert done.returncode == 0, done.stderr
        with np.load(path) as stored:
            found[n] = dict(stored)
        assert found[n].pop("size") == n
    assert found[1].keys() == found[2].keys()
    for name, alone in found[1].items():
        # Factors agree to rounding; iterations end at 1e-10 (Newton) and 1e-8 (audit).
        apart = 1e-8 if "multigrid" in name else 1e-10
        assert np.abs(alone).max() > 1e-3
        assert np.abs(found[2][name] - alone).max() < apart * np.abs(alone).max(), name


ADAPTIVE = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference.adaptivity.adaptive import solve_adaptively
from palpate.reference.adaptivity.goals import Goal, Quantity
from palpate.reference.fenicsx import COMM

asked = {Quantity.DISPLACEMENT_L2: 0.05, Quantity.SURFACE_AREA: 0.1, Quantity.DISPLACEMENT_MAX: 0.1}
goals = [Goal(quantity, bar) for quantity, bar in asked.items()]
found = solve_adaptively(load_problem(sys.argv[1]), goals)
if COMM.rank == 0:
    np.savez(sys.argv[2], displacement=found.displacement, bars=found.bars[2:],
             estimates=found.estimates, unknowns=found.num_unknowns)
"""


def test_two_ranks_refine_as_one_does(tmp_path, box):
    """One goes on from each mesh to the next; two raise the load on each from nothing."""
    mesh = box((2, 1, 1), (0.2, 0.1, 0.1))
    held = mesh.facet_groups["x0"]
    pull = Traction(mesh.facet_groups["x1"], (300.0, 0.0, -200.0))
    support = Support(np.unique(held).astype(np.int32), held)
    save_problem(tmp_path / "problem.npz", Problem(mesh, Material(2e4, 0.3), (support,), (pull,)))
    found = []
    for n in (1, 2):
        path = tmp_path / f"{n}.npz"
        done = run(n, "-c", ADAPTIVE, str(tmp_path / "problem.npz"), str(path))
        assert done.returncode == 0, done.stderr
        with np.load(path) as stored:
            found.append(dict(stored))
    alone, both = found
    assert np.array_equal(both["unknowns"], alone["unknowns"])
    assert len(alone["unknowns"]) > 2
    for name, apart in (("displacement", 1e-8), ("estimates", 1e-4), ("bars", 1e-4)):
        finite = np.isfinite(alone[name])
        assert finite.any()
        scale = np.abs(alone[name][finite]).max()
        np.testing.assert_allclose(both[name], alone[name], rtol=apart, atol=apart * scale)


SLIDES = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference.fenicsx import COMM
from palpate.reference.statics import solve_static

result = solve_static(load_problem(sys.argv[1]), degree=2)
if COMM.rank == 0:
    np.savez(sys.argv[2], size=COMM.size, u=result.displacement, pushes=result.support_forces)
"""


def test_points_slide_on_slanted_walls_and_turn_on_two_ranks_too(tmp_path, box):
    mesh = box((5, 2, 2), (0.5, 0.2, 0.2), jitter=0.2)
    end = mesh.facet_groups["x1"]
    walls = [
        Support([0], mesh.facet_groups[name], normal=normal)
        for name, normal in (("y0", (0.0, 1.0, 0.0)), ("z0", (0.0, 0.0, 1.0)))
    ]
    turned = Support([int(end[0, 0])], end, displacement=(0.02, 0.0, 0.0))
    root = Support([0], mesh.facet_groups["x0"], normal=(1.0, 0.0, 0.0))
    straight = Problem(mesh, Material(2e4, 0.4), (root, *walls), (BodyForce((900.0, 0.0, 0.0)),))
    slanted = turn(straight, rotation((1.0, 2.0, 3.0), 40.0))[0]
    spin = Rotation((1.0, 0.0, 0.0), (0.5, 0.1, 0.1), 0.5)
    clamp = Support([0], mesh.facet_groups["x0"])
    twisted = dataclasses.replace(
        straight, supports=(clamp, dataclasses.replace(turned, rotation=spin))
    )
    for name, problem in (("slanted", slanted), ("twisted", twisted)):
        save_problem(tmp_path / f"{name}.npz", problem)
        found = []
        for n in (1, 2):
            path = tmp_path / f"{name}-{n}.npz"
            done = run(n, "-c", SLIDES, str(tmp_path / f"{name}.npz"), str(path))
            assert done.returncode == 0, done.stderr
            with np.load(path) as stored:
                assert stored["size"] == n
                found.append((stored["u"], stored["pushes"]))
        for alone, both in zip(*found, strict=True):
            assert np.abs(alone).max() > 1e-3
            assert np.abs(both - alone).max() < 1e-10 * np.abs(alone).max()


PRESSES = """
import sys
import numpy as np
from palpate.meshes.problem_files import load_problem
from palpate.reference.fenicsx import COMM
from palpate.reference.result import Formulation
from palpate.reference.statics import solve_static

found = solve_static(load_problem(sys.argv[1]), degree=2, formulation=Formulation.MIXED)
if COMM.rank == 0:
    felt = found.tools[0].forces[-1] + found.tools[0].moments[-1]
    whole = (found.volume, found.strain_energy, found.smallest_det_f)
    np.savez(sys.argv[2], size=COMM.size, u=found.displacement, felt=felt, whole=whole,
             stress=found.cauchy_stress, pushes=found.support_forces)
"""


def test_the_mixed_form_presses_layers_on_two_ranks_as_on_one(tmp_path, box):
    mesh = box((4, 2, 2), (1.0, 0.5, 0.5), jitter=0.2)
    held = mesh.facet_groups["z0"]
    half = np.flatnonzero(mesh.points[mesh.cells].mean(axis=1)[:, 0] > 0.5).astype(np.int32)
    places = np.array([[0.4, 0.25, 0.8], [0.4, 0.25, 0.76]])
    problem = Problem(
        mesh,
        Material(2e4, 0.499),
        (Support(np.unique(held).astype(np.int32), held),),
        (Pressure(mesh.facet_groups["x1"], 300.0),),
        inclusions=(Inclusion(half, Material(6e4, 0.495)),),
        tools=(RigidTool(SphereShape(0.3), ToolPath(np.arange(2.0), places)),),
    )
    save_problem(tmp_path / "problem.npz", problem)
    found = []
    for n in (1, 2):
        path = tmp_path / f"{n}.npz"
        done = run(n, "-c", PRESSES, str(tmp_path / "problem.npz"), str(path))
        assert done.returncode == 0, done.stderr
        with np.load(path) as stored:
            found.append(dict(stored))
        assert found[-1].pop("size") == n
    for name, alone in found[0].items():
        scale = np.abs(alone).max()
        assert scale > 1e-3
        # The tool's force is settled to 1e-9.
        assert np.abs(found[1][name] - alone).max() < 3e-9 * scale, name


# Cells of another rank at an edge would be missing from its average.
SMOOTHED = """
import sys
from palpate.meshes.errors import InputError
from palpate.meshes.problem_files import load_problem
from palpate.reference.explicit import simulate_explicit
from palpate.reference.statics import solve_static

for solve in (solve_static, simulate_explicit):
    try:
        solve(load_problem(sys.argv[1]), element="smoothed")
    except InputError as error:
        print(error)
"""


def test_smoothed_tetrahedra_are_refused_on_two_ranks(tmp_path, box):
    mesh = box((2, 1, 1))
    held = mesh.facet_groups["x0"]
    support = Support(np.unique(held).astype(np.int32), held)
    span = TimeSpan(1e-3, 1e-3, 0.0, 1)
    save_problem(tmp_path / "problem.npz", Problem(mesh, Material(1e4, 0.3), (support,), (), span))
    told = run(2, "-c", SMOOTHED, str(tmp_path / "problem.npz"))
    assert told.returncode == 0, told.stderr
    assert told.stdout.count("smoothed tetrahedra run on one rank; leave mpirun out") == 4
    alone = run(1, "-c", SMOOTHED, str(tmp_path / "problem.npz"))
    assert (alone.returncode, alone.stdout) == (0, ""), alone.stderr


def test_the_command_solves_on_two_ranks_and_writes_once(tmp_path):
    path = tmp_path / "kidney.vtu"
    command = ("-m", "palpate.validation.cli", "solve", "kidney", "--with", "reference")
    done = run(2, *command, "-o", str(path))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("displacement [m]") == 1
    assert np.abs(read_answer(path)[2]["displacement"]).max() > 1e-3


@pytest.mark.nightly  # every collective call waits for the slower rank, and there are thousands
def test_references_are_built_on_two_ranks_and_are_those_of_one(tmp_path):
    case = shutil.copytree(EXAMPLE, tmp_path / "case") / "bar.toml"
    # No memory for a second mesh: the truth's own refinement is told above.
    case.write_text(case.read_text() + "\n[truth]\nmemory = 1e-6\n")
    done = run(2, "-m", "palpate.validation.cli", "reference", "build", str(case))
    assert done.returncode == 0, done.stderr
    for kind in ("P1", "smoothed"):
        for strain in ("linear", "green"):
            assert f"reference {kind}, {strain} strain: unchanged" in done.stdout


def test_what_ranks_cannot_share_rank_0_has_solved_apart(tmp_path):
    found = []
    for n in (1, 2):
        path = tmp_path / f"{n}.vtu"
        case = ("solve", str(EXAMPLE / "bar.toml"), "--with", "reference", "-o", str(path))
        done = run(n, "-m", "palpate.validation.cli", *case, "--element", "smoothed")
        assert done.returncode == 0, done.stderr
        found.append(read_answer(path)[2]["displacement"])
    assert np.abs(found[0]).max() > 1e-4
    assert np.array_equal(*found)


def test_an_error_is_told_once_with_its_exit_code():
    done = run(
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
    ranks.dismiss()


def test_both_mpis_tell_a_process_its_place(monkeypatch):
    for size, rank in (("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK")):
        with monkeypatch.context() as patch:
            patch.setenv(size, "4")
            patch.setenv(rank, "3")
            assert ranks.num_ranks() == 4
            assert ranks.is_follower()


# One rank alone is in trouble while the other waits for it.
LONELY = """
import sys
from palpate.meshes.errors import InputError
from palpate.meshes.problem_files import load_problem
from palpate.reference import ranks

ranks._PATIENCE = 1.0

def task(problem, say):
    from palpate.reference.fenicsx import COMM
    if COMM.rank == 1:
        raise InputError("this rank's own trouble")
    COMM.Barrier()

if ranks.is_follower():
    sys.exit(ranks.follow())
ranks.solve_on_ranks(task, load_problem(sys.argv[1]), time_limit=60.0, progress=print)
"""


def test_trouble_of_one_rank_alone_ends_them_all(tmp_path, box):
    mesh = box((1, 1, 1), (1.0, 1.0, 1.0))
    save_problem(tmp_path / "problem.npz", Problem(mesh, Material(1e3, 0.3), (), ()))
    done = run(2, "-c", LONELY, str(tmp_path / "problem.npz"))
    assert done.returncode == 2
    assert "rank 1: this rank's own trouble" in done.stderr
