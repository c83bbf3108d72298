"""A solution as a file that `palpate compare` and other programs read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.atomic_write import atomic_path
from palpate.meshes.errors import InputError
from palpate.meshes.files import MESH_SUFFIXES, write_mesh
from palpate.meshes.problem import Problem
from palpate.validation.exchange.case_folder import case_key
from palpate.validation.states import State

WRITTEN_SUFFIXES = (*MESH_SUFFIXES, ".npz")


def require_written_kind(path: Path) -> None:
    """Raise InputError for a file that no solution can be written to."""
    if path.suffix.lower() not in WRITTEN_SUFFIXES:
        raise InputError(f"{path}: unknown kind; use {', '.join(WRITTEN_SUFFIXES)}")


def write_solution(path: Path, problem: Problem, state: State) -> str:
    """Write a state: displacement and stresses on its mesh, or, as .npz, the whole motion.

    Stresses are fields of cells [Pa], where the state has them: `second_piola_kirchhoff_stress` and
    `cauchy_stress`, nine components row by row, and `von_mises_stress`.

    Args:
        path: .vtu, .vtk or .npz; a file of that name is replaced.
        problem: What was solved.
        state: Its solution, at the mesh's points.

    Returns:
        One line that says what is in the file.

    Raises:
        InputError: Another kind of file.
    """
    require_written_kind(path)
    said = f"{path}: displacement [m] of {problem.mesh.num_points} points, {state.strain} strain"
    motion = state.trajectory
    if path.suffix.lower() != ".npz":
        stresses = _stresses(state)
        write_mesh(
            path,
            problem.mesh,
            point_data={"displacement": state.displacement},
            cell_data=stresses,
        )
        if stresses:
            said += f", stresses [Pa] of {problem.mesh.num_cells} cells"
        if motion is None:
            return said
        return f"{said}, at {motion.times[-1]:g} s; a file .npz holds the whole motion"
    about: dict[str, Any] = {
        "tool": f"palpate, {state.simulator}",
        "element": state.element.value,
        **_forces(state),
    }
    arrays: dict[str, Any] = {"displacement": state.displacement}
    if motion is not None:
        arrays = {"displacement": motion.displacements, "times": motion.times}
        said += f", {len(motion.times)} states to {motion.times[-1]:g} s"
    arrays["case_key"] = np.array(case_key(problem, state.strain))
    arrays["about"] = np.array(json.dumps(about, allow_nan=False))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    return said


def _stresses(state: State) -> dict[str, NDArray[Any]]:
    if state.stresses is None:
        return {}
    return {
        "second_piola_kirchhoff_stress": state.stresses.second_piola_kirchhoff.reshape(-1, 9),
        "cauchy_stress": state.stresses.cauchy.reshape(-1, 9),
        "von_mises_stress": state.stresses.von_mises,
    }


def _forces(state: State) -> dict[str, Any]:
    return {} if state.tool_forces is None else {"tool_forces": state.tool_forces.tolist()}
