"""Steps of several lengths: stable, conserving, and the same as a scheme written by itself."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from typing import Any

import numpy as np
import pytest

import palpate
from palpate.fastsim import explicit_body
from palpate.fastsim.cell_classes import LEAST_DAMPING, PART_OF_CRITICAL
from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.dynamics import simulate
from palpate.fastsim.errors import UnstableStepError
from palpate.fastsim.explicit_body import ExplicitBody, Precision
from palpate.fastsim.grading.graded_mesh import GradedMesh
from palpate.fastsim.grading.size_fields import (
    distance_to_points,
    grow_with_distance,
    refine_to_size,
)
from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.rigid_tool import ContactRule, RigidTool, SphereShape, ToolPath

SIZE = 0.03
ELEMENTS = pytest.mark.parametrize("element", list(Element))


def graded_block(smallest: float, *, divisions: int = 2, held: bool = True) -> Problem:
    """A block of tissue, 30 mm wide, with small cells at a corner."""
    graded = GradedMesh(brick_box((divisions,) * 3, (SIZE,) * 3, ragged=0.2))
    near = distance_to_points(np.full((1, 3), SIZE))
    refine_to_size(graded, grow_with_distance(near, smallest=smallest, growth=0.8), max_cells=4000)
    mesh = graded.mesh
    at = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    supports = (Support(at),) if held else ()
    return Problem(mesh, Material(3000.0, 0.45, 1000.0), supports, ())


def free_motion(
    problem: Problem, element: Element, strain: Strain, time_step: float, wave: float
) -> ExplicitBody:
    """A body with classes of cells, bent and twisted by so many radians, at rest."""
    body = ExplicitBody(
        problem, strain=strain, element=element, time_step=time_step, multirate=True
    )
    x, y, _ = problem.mesh.points.T
    bent = np.zeros_like(problem.mesh.points)
    bent[:, 1] = wave * x * x / SIZE
    bent[:, 2] = wave * x * y / SIZE
    body.set_state(bent)
    return body


def single_step(problem: Problem, element: Element) -> float:
    """Critical step with one class [s]."""
    return ExplicitBody(problem, element=element).critical_time_step


class OwnScheme:
    """The step of multirate.hpp by other formulas: cells by F, and Chebyshev's recursion."""

    def __init__(self, body: ExplicitBody) -> None:
        problem, self.dt = body.problem, body.time_step
        mesh, material = problem.mesh, problem.material
        E, nu = material.youngs_modulus, material.poissons_ratio
        self.lmbda, self.mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        self.cells, self.is_green = mesh.cells, body.elastic.strain is Strain.GREEN
        edges = (mesh.points[mesh.cells[:, 1:]] - mesh.points[mesh.cells[:, :1]]).transpose(0, 2, 1)
        self.inverse, self.volumes = np.linalg.inv(edges), np.linalg.det(edges) / 6.0
        self.is_smoothed = body.elastic.element is Element.SMOOTHED
        self.mass = np.bincount(
            mesh.cells.ravel(), np.repeat(self.volumes, 4) * material.density / 4.0
        )[:, None]
        self.is_free = np.ones((mesh.num_points, 1))
        for support in problem.supports:
            self.is_free[support.points] = 0.0
        of_cells = body.classes.of_cells
        self.last = int(of_cells.max())
        patches: dict[tuple[int, ...], list[int]] = defaultdict(list)
        for c, cell in enumerate(mesh.cells.tolist()):
            for i, p in enumerate(cell):
                patches[(p,)].append(c)
                for q in cell[:i]:
                    patches[(min(p, q), max(p, q))].append(c)
        self.of_cells = of_cells
        self.is_edge = np.array([len(key) == 2 for key in patches])
        self.of_patches = np.array([of_cells[cells].max() for cells in patches.values()])
        self.patch = np.repeat(np.arange(len(patches)), [len(cells) for cells in patches.values()])
        self.cell = np.concatenate([np.array(cells) for cells in patches.values()])
        self.around = np.bincount(self.patch, self.volumes[self.cell])

    def force(self, u: np.ndarray, number: int) -> np.ndarray:
        """Minus R of a class [N]."""
        ends = (u[self.cells[:, 1:]] - u[self.cells[:, :1]]).transpose(0, 2, 1)
        H = ends @ self.inverse
        strain = 0.5 * (H + H.transpose(0, 2, 1))
        if self.is_green:
            strain += 0.5 * H.transpose(0, 2, 1) @ H
        S = np.zeros_like(strain)
        if self.is_smoothed:
            mean = np.zeros((len(self.around), 3, 3))
            np.add.at(mean, self.patch, (self.volumes[:, None, None] * strain)[self.cell])
            mean /= self.around[:, None, None]
            trace = np.trace(mean, axis1=1, axis2=2)[:, None, None]
            shear = self.is_edge[:, None, None] * 2.0 * self.mu / 6.0
            stress = np.where(shear > 0.0, shear * mean, self.lmbda / 4.0 * trace * np.eye(3))
            stress[self.of_patches != number] = 0.0
            np.add.at(S, self.cell, stress[self.patch])
            if self.is_green:
                self.add_blend(strain, mean, S, self.is_edge & (self.of_patches == number))
        else:
            trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
            S = self.lmbda * trace * np.eye(3) + 2.0 * self.mu * strain
            S[self.of_cells != number] = 0.0
        P = (np.eye(3) + H) @ S if self.is_green else S
        of_corners = self.volumes[:, None, None] * P @ self.inverse.transpose(0, 2, 1)
        out = np.zeros_like(u)
        for k in range(3):
            np.add.at(out, self.cells[:, k + 1], -of_corners[:, :, k])
            np.add.at(out, self.cells[:, 0], of_corners[:, :, k])
        return out

    def add_blend(
        self, strain: np.ndarray, mean: np.ndarray, S: np.ndarray, is_in: np.ndarray
    ) -> None:
        """What goes back to the plain cells where these edges are compressed."""
        parts = (strain[self.cell] - mean[self.patch], self.volumes[self.cell])
        squares = np.bincount(self.patch, parts[1] * (parts[0] ** 2).sum(axis=(1, 2)))
        rate = -min(self.lmbda / self.mu + 2.0, 6.0) / 0.5
        x = np.clip(rate * np.trace(mean, axis1=1, axis2=2) - 0.4, 0.0, 1.0) * is_in
        pressed = self.mu / 6.0 * rate * 6.0 * x * (1.0 - x) * squares / self.around
        own = self.mu / 3.0 * x * x * (3.0 - 2.0 * x)
        added = own[self.patch, None, None] * parts[0]
        np.add.at(S, self.cell, added + pressed[self.patch, None, None] * np.eye(3))

    def inner(self, level: int, z: np.ndarray, frozen: np.ndarray, h: float) -> np.ndarray:
        """The mean acceleration over h of classes from `level` on, of two stabilized half steps."""
        if level > self.last:
            return self.is_free * frozen / self.mass
        nu = 1.0 + 1.5**2 / 8.0
        t = (1.0, nu, 2.0 * nu * nu - 1.0)
        alpha = 2.0 * (4.0 * nu) / t[2]  # 2 T_2'(nu) / T_2(nu)
        span = h * np.sqrt(0.3)
        first = self.inner(level + 1, z, frozen + self.force(z, level), span)
        y1 = h * h * first / (alpha * nu)
        second = self.inner(level + 1, z + y1, frozen + self.force(z + y1, level), span)
        y2 = (2.0 * nu * t[1] * y1 + 2.0 / alpha * h * h * t[1] * second) / t[2]
        return 2.0 * y2 / (h * h)

    def run(self, u: np.ndarray, num_steps: int, damping: float) -> np.ndarray:
        """Displacement after some steps from rest, with a mass damping [1/s]."""
        half = 0.5 * damping * self.dt
        acceleration = self.inner(1, u, self.force(u, 0), self.dt)
        before, now = u + 0.5 * self.dt**2 * acceleration, u
        for _ in range(num_steps):
            acceleration = self.inner(1, now, self.force(now, 0), self.dt)
            ahead = 2.0 * now - (1.0 - half) * before + self.dt**2 * acceleration
            before, now = now, ahead / (1.0 + half)
        return now


@ELEMENTS
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize(("ratio", "num_classes"), [(1.4, 2), (2.6, 3), (3.5, 4)])
def test_the_core_agrees_with_a_scheme_written_by_itself(
    element: Element, strain: Strain, ratio: float, num_classes: int
) -> None:
    problem = graded_block(0.004)
    step = 0.8 * ratio * single_step(problem, element)
    span = TimeSpan(step, step, num_outputs=1, mass_damping=1e-3 / step)
    damped = dataclasses.replace(problem, time=span)
    body = free_motion(damped, element, strain, step, 0.03)
    assert len(body.classes.counts) == num_classes
    start = body.displacement.copy()
    body.step(24)
    found = OwnScheme(body).run(start, 24, span.mass_damping)
    assert np.abs(found - start).max() > 0.1 * np.abs(start).max()
    np.testing.assert_allclose(body.displacement, found, rtol=0.0, atol=1e-10 * np.abs(found).max())


@ELEMENTS
def test_a_body_far_from_where_it_was_is_as_it_was(element: Element) -> None:
    """Cells of other classes are not taken for inverted, though not all of their points move."""
    problem = graded_block(0.004, held=False)
    step = 2.0 * single_step(problem, element)
    span = TimeSpan(step, step, num_outputs=1, mass_damping=1e-2 / step)
    still = dataclasses.replace(problem, time=span)
    body = ExplicitBody(still, element=element, time_step=step, multirate=True)
    assert len(body.classes.counts) > 1
    away = np.tile([0.0, 10.0 * SIZE, 0.0], (problem.mesh.num_points, 1))
    body.set_state(away)
    body.step(20)
    # Differences of places of 0.3 m are rounded by 1e-16 of them, in cells of 4 mm.
    np.testing.assert_allclose(body.displacement, away, rtol=0.0, atol=1e-10 * SIZE)


def steps_of_modes(problem: Problem, element: Element, time_step: float) -> np.ndarray:
    """Eigenvalues of h^2 M^-1 W K of the assembled step, which is stable in 0 to 4."""
    body = ExplicitBody(
        problem, strain=Strain.LINEAR, element=element, time_step=time_step, multirate=True
    )
    is_free = np.ones((problem.mesh.num_points, 3), dtype=bool)
    is_free[problem.supports[0].points] = False
    free = np.flatnonzero(is_free)
    rest = np.zeros_like(problem.mesh.points)
    columns = []
    for entry in free:
        unit = rest.copy()
        unit.flat[entry] = 1e-3
        body.run.set_state(unit, rest, 0.0)
        columns.append(-1e3 * body._force_of_step().ravel()[free])
    mobility = time_step**2 / np.repeat(body.mass, 3)[free]
    assert len(body.classes.counts) > 1
    return np.linalg.eigvals(mobility[:, None] * np.array(columns).T)


@ELEMENTS
@pytest.mark.parametrize("ratio", [1.2, 1.5, 1.9, 2.3, 2.9, 3.6, 4.5, 6.3])
def test_no_mode_grows_up_to_the_critical_step(
    element: Element, ratio: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explicit_body, "SAFETY", 1.0)
    problem = graded_block(0.004)
    modes = steps_of_modes(
        problem, element, ratio * PART_OF_CRITICAL * single_step(problem, element)
    )
    # Of z^2 - (2 - w) z + 1 = 0; those of w in (0, 4) have modulus 1.
    halves = 0.5 * (2.0 - modes.astype(complex))
    root = np.sqrt(halves**2 - 1.0)
    assert np.abs([halves + root, halves - root]).max() <= 1.0 + 1e-9
    assert modes.real.min() > 0.0


def energy(body: ExplicitBody) -> float:
    kinetic = 0.5 * float(np.sum(body.mass[:, None] * body.velocity() ** 2))
    return body.elastic.strain_energy(body.displacement) + kinetic


def momentum(body: ExplicitBody) -> float:
    """Over the sum of its parts' magnitudes."""
    parts = body.mass[:, None] * body.velocity()
    return float(np.abs(parts.sum(axis=0)).max() / np.abs(parts).sum())


@ELEMENTS
def test_a_free_swing_keeps_momentum_and_energy(element: Element) -> None:
    problem = graded_block(0.004, held=False)
    body = free_motion(problem, element, Strain.LINEAR, 2.0 * single_step(problem, element), 0.03)
    start, energies = energy(body), []
    for _ in range(100):
        body.step(100)
        energies.append(energy(body) / start)
    # The scheme's energy is conserved; the body's swings beside it by parts of (omega h)^2.
    swing = np.ptp(energies)
    assert swing < 0.02
    assert abs(np.mean(energies[-20:]) - np.mean(energies[:20])) < 0.25 * swing
    assert momentum(body) < 1e-12


@ELEMENTS
def test_under_green_strain_a_little_damping_keeps_energy_from_creeping_up(
    element: Element,
) -> None:
    problem = graded_block(0.004, held=False)
    step = 2.0 * single_step(problem, element)
    span = TimeSpan(step, step, num_outputs=1, mass_damping=LEAST_DAMPING / step)
    damped = dataclasses.replace(problem, time=span)
    body = free_motion(damped, element, Strain.GREEN, step, 0.03)
    assert len(body.classes.counts) == 3
    energies = [energy(body)]
    for _ in range(20):
        body.step(100)
        energies.append(energy(body))
    # Half of the energy is kinetic, which the damping takes at twice its rate.
    assert energies[-1] == pytest.approx(energies[0] * np.exp(-2000 * LEAST_DAMPING), rel=0.15)
    assert momentum(body) < 1e-12
    weak = dataclasses.replace(span, mass_damping=0.9 * span.mass_damping)
    with pytest.raises(InputError, match="need a mass damping of"):
        ExplicitBody(dataclasses.replace(problem, time=weak), element=element, multirate=True)


def pressed(span: TimeSpan, **more: Any) -> Problem:
    """A larger block with small cells under a ball that comes down on it."""
    problem = graded_block(0.002, divisions=4)
    down = ToolPath(
        np.array([0.0, 0.08]), np.array([[SIZE, SIZE, SIZE + 0.0062], [SIZE, SIZE, SIZE + 0.004]])
    )
    tool = RigidTool(SphereShape(0.006), down, contact=ContactRule.FACETS, **more)
    return dataclasses.replace(problem, tools=(tool,), time=span)


SPAN = TimeSpan(0.1, None, num_outputs=2, mass_damping=20.0)


def test_contact_is_that_of_one_class() -> None:
    problem = pressed(SPAN)
    law = ContactLaw(ContactForm.PENALTY)
    one = simulate(problem, contact=law)
    # So small a body would not pay for the looks at its tool: its step is asked for.
    step = 0.05 / np.ceil(0.05 / (2.5 * one.time_step))
    longer = dataclasses.replace(SPAN, time_step=step)
    several = simulate(dataclasses.replace(problem, time=longer), multirate=True)
    assert len(several.classes) >= 3
    assert sum(count for count, _ in several.classes) == problem.mesh.num_cells
    assert several.classes[0][1] == several.time_step > 2.0 * one.time_step
    assert several.classes[1][1] == pytest.approx(0.548 * several.time_step, rel=1e-3)
    scale = np.abs(one.displacements[-1]).max()
    assert scale > 0.001
    np.testing.assert_allclose(
        several.displacements[-1], one.displacements[-1], rtol=0.0, atol=0.02 * scale
    )
    # The mean force over an output, of impulses, is what the supports and damping take up.
    assert several.tools[0].mean_forces[-1] == pytest.approx(
        one.tools[0].mean_forces[-1], abs=0.02 * np.linalg.norm(one.tools[0].mean_forces[-1])
    )


@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("law", [Law.SAINT_VENANT_KIRCHHOFF, Law.NEO_HOOKEAN_STABLE])
def test_loads_and_supports_are_those_of_one_class(law: Law, precision: Precision) -> None:
    mesh = graded_block(0.002, divisions=4).mesh
    held = np.flatnonzero(mesh.points[:, 0] < 1e-9).astype(np.int32)
    pulled = np.flatnonzero(mesh.points[:, 0] > SIZE - 1e-9).astype(np.int32)
    ramp = TabularAmplitude((0.0, 0.05), (0.0, 1.0))
    problem = Problem(
        mesh,
        Material(3000.0, 0.45, 1000.0, law),
        (
            Support(held),
            Support(
                pulled,
                components=(True, False, False),
                displacement=(0.003, 0.0, 0.0),
                amplitude=ramp,
            ),
        ),
        (
            BodyForce((0.0, 0.0, -2000.0)),
            Pressure(side(mesh, 2, SIZE), 30.0, amplitude=ramp),
        ),
        TimeSpan(0.1, None, num_outputs=2, mass_damping=20.0),
        inclusions=(
            Inclusion(np.arange(0, 60, dtype=np.int32), Material(6000.0, 0.4, 1000.0, law)),
        ),
    )
    one = simulate(problem, precision=precision)
    several = simulate(problem, precision=precision, multirate=True)
    assert len(several.classes) >= 3
    scale = np.abs(one.displacements).max()
    # Both have errors by parts of (omega h)^2; the step is three times as long.
    np.testing.assert_allclose(
        several.displacements, one.displacements, rtol=0.0, atol=0.02 * scale
    )
    np.testing.assert_allclose(several.displacements[:, pulled, 0], one.displacements[:, pulled, 0])


def test_a_state_names_its_classes() -> None:
    state = palpate.simulate(pressed(SPAN), multirate=True)
    counts, steps = zip(*state.details["classes"], strict=True)
    assert sum(counts) == state.problem.mesh.num_cells
    assert list(steps) == sorted(steps, reverse=True)
    still = dataclasses.replace(graded_block(0.004), loads=(BodyForce((0.0, 0.0, -1.0)),))
    with pytest.raises(InputError, match="fastsim's motions"):
        palpate.solve(still, multirate=True)


def test_a_tool_is_pushed_by_what_it_pushes_with() -> None:
    problem = pressed(SPAN)
    body = ExplicitBody(problem, multirate=True)
    body.step(body.steps_per_output)
    body.look()
    on_body = body.load().sum(axis=0)
    on_tool = body.take_tool_records()["force"][0]
    assert np.linalg.norm(on_tool) > 1e-3
    np.testing.assert_allclose(on_body, -on_tool, rtol=1e-12, atol=1e-12)


def test_it_does_nothing_where_it_would_save_nothing() -> None:
    mesh = brick_box((3, 3, 3), (SIZE,) * 3)
    problem = Problem(mesh, Material(3000.0, 0.45, 1000.0), (), ())
    one = ExplicitBody(problem, strain=Strain.LINEAR)
    same = ExplicitBody(problem, strain=Strain.LINEAR, multirate=True)
    assert same.classes.counts == (mesh.num_cells,)
    assert same.time_step == one.time_step
    with pytest.raises(UnstableStepError):
        ExplicitBody(problem, strain=Strain.LINEAR, multirate=True, time_step=100.0 * one.time_step)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"num_threads": 2}, "several threads"),
        ({"contact": ContactLaw(ContactForm.CONSTRAINT)}, "the constraint of contact"),
        ({"body_contact": ContactLaw(ContactForm.PENALTY)}, "touch each other"),
        ({"device": "cuda:0"}, "the device 'cuda:0'"),
    ],
)
def test_what_it_does_not_know_is_refused(more: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        ExplicitBody(pressed(SPAN), multirate=True, **more)


def test_problems_that_it_does_not_know_are_refused() -> None:
    with pytest.raises(InputError, match="friction"):
        ExplicitBody(pressed(SPAN, friction_coefficient=0.3), multirate=True)
    stiffness = dataclasses.replace(SPAN, stiffness_damping=1e-4)
    with pytest.raises(InputError, match="stiffness damping"):
        ExplicitBody(pressed(stiffness), multirate=True)
    ogden = dataclasses.replace(
        graded_block(0.004), material=Material(3000.0, 0.45, 1000.0, law=Law.COROTATIONAL)
    )
    with pytest.raises(InputError, match="the law corotational"):
        ExplicitBody(ogden, multirate=True)
