"""What is handed to other simulators is complete, strict JSON, and the same in both files."""

import dataclasses
import json

import meshio
import numpy as np
import pytest

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Strain, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SphereShape, SurfaceShape, ToolPath
from palpate.validation.exchange.case_folder import case_key, write_case_folder


def read_folder(folder):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    text = (folder / "case.json").read_text("utf-8")
    with np.load(folder / "rest.npz") as stored:
        return json.loads(text, parse_constant=refuse), dict(stored)


def test_both_files_hold_the_same_arrays_and_are_exact(tmp_path, problem):
    write_case_folder(tmp_path / "c", problem, Strain.GREEN, name="block")
    _, arrays = read_folder(tmp_path / "c")
    mesh = meshio.read(tmp_path / "c" / "rest.vtu")
    np.testing.assert_array_equal(mesh.points, problem.mesh.points)
    np.testing.assert_array_equal(arrays["points"], problem.mesh.points)
    for name, field in mesh.point_data.items():
        np.testing.assert_array_equal(field, arrays[name])
    assert set(mesh.point_data) == {
        "fixed", "prescribed_displacement", "external_force", "lumped_mass",
    }  # fmt: skip
    assert set(mesh.cell_data) == {"youngs_modulus", "poissons_ratio", "density"}


def test_time_tools_loads_and_pressure_are_described(tmp_path, problem):
    ramp = TabularAmplitude((0.0, 1.0), (0.0, 1.0))
    facets = problem.mesh.boundary_facets[:2]
    tool = RigidTool(SphereShape(0.2), ToolPath(np.array([0.0]), np.array([[0.0, 0.0, 2.0]])))
    full = dataclasses.replace(
        problem,
        loads=(BodyForce((0.0, 0.0, -5.0), ramp), Pressure(facets, 3.0)),
        time=TimeSpan(0.5, 1e-3, 0.1, 10),
        tools=(tool,),
    )
    write_case_folder(tmp_path, full, Strain.LINEAR, name="full")
    case, arrays = read_folder(tmp_path)
    assert case["strain"] == "linear"
    assert case["time"]["output_times"] == pytest.approx(np.linspace(0, 0.5, 11).tolist())
    assert case["loads"][0]["amplitude"]["factors"] == [0.0, 1.0]
    assert case["tools"][0]["shape"] == {"kind": "SphereShape", "radius": 0.2}
    assert arrays["pressure"].tolist() == [3.0, 3.0]
    np.testing.assert_array_equal(arrays["pressure_facets"], facets)
    np.testing.assert_array_equal(arrays["external_force_0"], arrays["external_force"])


def test_the_key_changes_with_material_and_strain(problem):
    keys = {case_key(problem, strain) for strain in Strain}
    other = dataclasses.replace(problem, material=Material(1001.0, 0.3))
    assert len(keys | {case_key(other, Strain.GREEN)}) == 3


def test_a_file_in_the_way_and_a_tool_by_surface_are_refused(tmp_path, problem):
    (tmp_path / "f").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        write_case_folder(tmp_path / "f", problem, Strain.GREEN, name="x")
    shape = SurfaceShape(problem.mesh.surface())
    tool = RigidTool(shape, ToolPath(np.array([0.0]), np.zeros((1, 3))))
    with pytest.raises(InputError, match="surface"):
        write_case_folder(
            tmp_path, dataclasses.replace(problem, tools=(tool,)), Strain.GREEN, name="x"
        )
