"""Devices by name, and what is said where one is not there."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.gpu.devices import (
    DeviceUnavailableError,
    UnsupportedOnDeviceError,
    check_device,
    known_devices,
)
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import RigidTool, SurfaceShape, ToolPath
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.tet_mesh import TetMesh

SPAN = TimeSpan(0.01)
SOFT = Material(1e4, 0.3, 1000.0)


@pytest.mark.parametrize("device", ["cuda:0", "warp:cpu"])
def test_without_warp_it_says_what_to_install_and_all_else_works(
    ragged_box: TetMesh, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    monkeypatch.setitem(sys.modules, "warp", None)  # an import of it fails
    problem = Problem(ragged_box, SOFT, (), (), SPAN)
    with pytest.raises(DeviceUnavailableError, match=r"pip install .*palpate\[gpu\]") as caught:
        simulate(problem, device=device)
    assert caught.value.devices == ("cpu",) == known_devices()
    assert simulate(problem).num_steps > 0


@pytest.mark.parametrize("device", ["cuda:7", "gpu", "cuda:x", "CPU", ""])
def test_a_device_that_is_not_there_is_refused_with_those_that_are(device: str) -> None:
    pytest.importorskip("warp")
    with pytest.raises(DeviceUnavailableError, match="this machine has cpu, warp:cpu") as caught:
        check_device(device)
    assert caught.value.devices == known_devices()
    assert isinstance(caught.value, InputError)  # exit code 2


def test_cpu_is_the_core(ragged_box: TetMesh) -> None:
    problem = Problem(ragged_box, SOFT, (), (), SPAN)
    plain, named = ExplicitBody(problem), ExplicitBody(problem, device="cpu")
    assert plain.instruction_set == named.instruction_set in ("baseline", "avx2", "avx512")
    pytest.importorskip("warp")
    assert ExplicitBody(problem, device="warp:cpu").instruction_set == "warp:cpu"


def test_what_only_the_core_does_is_refused(ragged_box: TetMesh) -> None:
    pytest.importorskip("warp")
    neo = Problem(ragged_box, Material(1e4, 0.3, 1000.0, Law.NEO_HOOKEAN), (), (), SPAN)
    with pytest.raises(UnsupportedOnDeviceError, match=r"neo_hookean|neo-hookean"):
        ExplicitBody(neo, device="warp:cpu")
    ExplicitBody(neo, strain=Strain.LINEAR, device="warp:cpu")  # all laws are Hooke's there
    plain = Problem(ragged_box, SOFT, (), (), SPAN)
    with pytest.raises(UnsupportedOnDeviceError, match="itself"):
        ExplicitBody(plain, body_contact=ContactLaw(ContactForm.PENALTY), device="warp:cpu")
    damped = Problem(ragged_box, SOFT, (), (), replace(SPAN, stiffness_damping=1e-3))
    with pytest.raises(UnsupportedOnDeviceError, match="stiffness damping"):
        ExplicitBody(damped, device="warp:cpu")
    path = ToolPath(np.array([0.0]), np.array([[0.8, 0.5, 3.0]]))
    tool = RigidTool(SurfaceShape(shape_sphere(0.4, edge_length=0.3)), path)
    spring = Spring.on(ragged_box, (0.8, 0.5, 1.2), 0.5, 100.0, AnchorPath([0.0], np.zeros((1, 3))))
    pulled = Problem(ragged_box, SOFT, (), (), SPAN, springs=(spring,))
    with pytest.raises(UnsupportedOnDeviceError, match="a spring over a patch"):
        ExplicitBody(pulled, device="warp:cpu")
    with pytest.raises(UnsupportedOnDeviceError, match="surface"):
        ExplicitBody(Problem(ragged_box, SOFT, (), (), SPAN, (tool,)), device="warp:cpu")
