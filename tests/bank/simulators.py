"""CalculiX and MuJoCo, run on a model of their own, beside the case that is made of it."""

import dataclasses
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, PointForce
from palpate.validation.peers.registry import interpreter_with

has_ccx = shutil.which("ccx") is not None
needs_ccx = pytest.mark.skipif(not has_ccx, reason="CalculiX (ccx) is not installed")
# Of the equilibrium, which is printed with seven digits.
TIGHT = "*CONTROLS, PARAMETERS=FIELD\n1e-9, 1e-6, , , 1e-9, , ,\n"


def with_ccx(folder, text):
    """Labels of nodes, and displacements in the file's own unit; None where it gives up."""
    for old in folder.glob("own.*"):
        old.unlink()
    tight = re.sub(r"(\*STATIC.*\n(?:[^*\n].*\n)?)", rf"\1{TIGHT}", text, count=1, flags=re.I)
    (folder / "own.inp").write_text(tight, encoding="latin-1")
    done = subprocess.run(
        ["ccx", "own"], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    printed = folder / "own.dat"
    if done.returncode or "*ERROR" in done.stdout or not printed.exists():
        return None
    table = printed.read_text()
    last = table[max(table.rfind("displacements"), 0) :]
    rows = [line.split() for line in last.splitlines() if re.match(r"\s+\d+\s+\S+E", line)]
    if not rows:
        return None
    values = np.array(rows, dtype=float)
    return values[:, 0].astype(int), values[:, 1:]


def agree_with_ccx(folder, text, case, metres):
    """Whether CalculiX could solve a deck; asserts that the case's solution is the same.

    Args:
        folder: Where it may write.
        text: The deck, whose nodes are numbered from 1.
        case: What was made of it.
        metres: One unit of length of the deck [m].
    """
    found = with_ccx(folder, text)
    if found is None:
        return False
    ours = solve_static(case.problem, strain=case.strain).displacement
    # Nodes of no element come last, and some are printed twice.
    labels, first = np.unique(found[0], return_index=True)
    if labels[: len(ours)].tolist() != list(range(1, len(ours) + 1)):
        return False
    theirs = metres * found[1][first][: len(ours)]
    # Seven digits are printed; ccx stops at a residual of 1e-9.
    apart = np.abs(ours - theirs).max()
    assert apart <= 3e-6 * np.abs(theirs).max(), f"{apart / np.abs(theirs).max():.2g}\n{text}"
    return True


# A Newton method with MuJoCo's own forces: at rest, what is passive balances gravity and all that
# is applied; steps of its own would take a hundred thousand to get there.
_REST = r"""
import json, sys
import mujoco, numpy as np

def forces(model, data, q):
    data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = q, 0.0, 0.0
    mujoco.mj_forward(model, data)
    free = data.qfrc_passive + data.qfrc_applied + data.qfrc_actuator - data.qfrc_bias
    return free + data.qfrc_constraint

def rest(path):
    spec = mujoco.MjSpec.from_file(path)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    before, q = data.flexvert_xpos.copy(), data.qpos.copy()
    size = float(np.ptp(before, axis=0).max())
    scale = max(np.abs(data.qfrc_bias).max(), np.abs(forces(model, data, q)).max(), 1e-30)
    for _ in range(60):
        found = forces(model, data, q)
        if np.abs(found).max() <= 1e-12 * scale:
            break
        h = 1e-6 * size
        tangent = [
            (forces(model, data, q + step) - forces(model, data, q - step)) / (2 * h)
            for step in h * np.eye(model.nv)
        ]
        move = np.linalg.solve(np.column_stack(tangent), -found)
        share, most = min(1.0, 0.1 * size / max(np.abs(move).max(), 1e-30)), np.linalg.norm(found)
        while share > 1e-4 and np.linalg.norm(forces(model, data, q + share * move)) > most:
            share /= 2
        q = q + share * move
    forces(model, data, q)
    left = float(np.abs(forces(model, data, q)).max() / scale)
    return {"moved": (data.flexvert_xpos - before).tolist(), "left": left, "written": spec.to_xml()}

for line in sys.stdin:
    try:
        print(json.dumps(rest(json.loads(line))), flush=True)
    except Exception as error:
        print(json.dumps({"error": str(error)}), flush=True)
"""


class MuJoCo:
    """A process that solves one model after another."""

    def __init__(self):
        interpreter = interpreter_with("mujoco")
        assert interpreter is not None
        self.process = subprocess.Popen(
            [interpreter, "-P", "-c", _REST],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip

    def rest(self, path):
        """Its own displacement at rest and the model as it writes it out, or its error."""
        self.process.stdin.write(json.dumps(str(path)) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def agree(self, path, case):
        """Whether MuJoCo could solve a model; asserts that the case's solution is the same.

        Under MuJoCo's own share of the weight, the same at each point, as the import's note says.
        """
        found = self.rest(path)
        if "error" in found or not found["left"] < 1e-9:
            return False
        problem = case.problem
        count, share = problem.mesh.num_points, np.zeros(3)
        for load in problem.loads:
            assert isinstance(load, BodyForce)
            share += problem.mesh.volume * np.array(load.force_density) / count
        evenly = PointForce(np.arange(count, dtype=np.int32), np.tile(share, (count, 1)))
        ours = solve_static(dataclasses.replace(problem, loads=(evenly,))).displacement
        theirs = np.array(found["moved"])
        assert np.abs(ours - theirs).max() <= 1e-6 * max(np.abs(theirs).max(), 1e-9)
        return True

    def close(self):
        """End the process."""
        for pipe in (self.process.stdin, self.process.stdout):
            pipe.close()
        self.process.wait(timeout=60)
