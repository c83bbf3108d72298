"""A rank of mpirun that fails alone: an error with its exit code, and no process left."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from bank import support

from palpate.meshes.boundary_conditions import Traction
from palpate.meshes.problem import Material, Problem
from palpate.meshes.problem_files import save_problem

pytestmark = [
    pytest.mark.dolfinx,
    pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc"),
]

# What the command line does, with a task of the test's own instead of the command.
COMMAND = """
import ctypes
import os
import signal
import sys
import time
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.problem_files import load_problem
from palpate.reference import ranks
from palpate.reference.errors import ReferenceFailedError
from palpate.validation import cli

folder, trouble = Path(sys.argv[1]), sys.argv[2]
ranks._GRACE = 1.0
(folder / f"{os.getpid()}.pid").touch()

def task(problem, say):
    from palpate.reference import fenicsx, linear_solver, statics
    from palpate.reference.fenicsx import COMM, PETSc
    fenicsx.PATIENCE = 0.5
    direct = linear_solver.LinearSolver._direct

    class Failing:
        def __init__(self, ksp):
            self.ksp = ksp
        def __getattr__(self, name):
            return getattr(self.ksp, name)
        def solve(self, b, x):
            raise PETSc.Error(55)

    if trouble == "memory" and COMM.rank == 1:
        linear_solver.LinearSolver._direct = lambda self: Failing(direct(self))
    if trouble == "memory":
        return statics.solve_static(problem)
    if trouble == "stop" and COMM.rank == 0:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(3600.0)
    if trouble == "kill" and COMM.rank == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if trouble == "stuck" and COMM.rank == 0:
        ctypes.PyDLL(None).sleep(3600)  # like PETSc it lets no other thread of Python run
    if trouble == "alone" and COMM.rank == 1:
        raise InputError("this rank's own trouble")
    COMM.Barrier()

def late(problem, say):
    from palpate.reference.fenicsx import COMM
    if COMM.rank == 1:
        raise MemoryError("no place for the last thing")
    return "an answer"

def command(*, standalone_mode):
    problem = load_problem(folder / "problem.npz")
    if trouble == "alone":
        try:
            print(ranks.solve_on_ranks(late, problem, time_limit=250.0, progress=print), flush=True)
        except ReferenceFailedError as error:
            print(error, flush=True)
    ranks.solve_on_ranks(
        task, problem, time_limit=1.0 if trouble == "stuck" else 250.0, progress=print
    )

cli.app = command
cli.main()
"""


def has_ended(number):
    """Soon: mpirun does not wait for those that it kills."""
    for _ in range(100):
        stat = Path(f"/proc/{number}/stat")
        try:
            # Z: ended, and not yet noticed by who inherited it.
            if stat.read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize(
    ("trouble", "codes", "reported"),
    [
        ("alone", {2}, "rank 1: this rank's own trouble"),
        ("memory", {4}, "rank 1: error code 55"),
        pytest.param("stop", {143}, "", marks=pytest.mark.nightly),
        # Open MPI tells the signal as shells do, MPICH as it is.
        pytest.param("kill", {137, 9}, "", marks=pytest.mark.nightly),
        pytest.param("stuck", {142, 14}, "", marks=pytest.mark.nightly),
    ],
)
@pytest.mark.long
def test_trouble_of_one_rank_ends_them_all(mpirun, tmp_path, box, trouble, codes, reported):
    mesh = box((1, 1, 1), (1.0, 1.0, 1.0))
    pull = Traction(mesh.facet_groups["x1"], (10.0, 0.0, 0.0))
    save_problem(
        tmp_path / "problem.npz", Problem(mesh, Material(1e3, 0.3), (support(mesh, "x0"),), (pull,))
    )
    done = mpirun(2, "-c", COMMAND, str(tmp_path), trouble)
    assert done.returncode in codes, (done.returncode, done.stderr)
    assert reported in done.stderr
    numbers = [int(file.stem) for file in tmp_path.glob("*.pid")]
    assert len(numbers) == 2
    assert all(map(has_ended, numbers))
    if trouble == "alone":
        # The answer is not taken for good where another rank had trouble after its part of it.
        assert "rank 1: no place for the last thing" in done.stdout
        assert "an answer" not in done.stdout
