"""The judge's own explicit motion, with one slip in it: central differences in NumPy.

    (1/dt^2 + d/(2 dt)) a(t + dt) = (F - R(a(t))) / m + 2/dt^2 a(t) - (1/dt^2 - d/(2 dt)) a(t - dt)

from rest, a(-dt) = a(0) + dt^2/2 a''(0); lumped m, D = d M. Only the first part of a motion is
stepped, as far as NumPy goes in a blink.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.body import Body, Mask
from palpate.validation.diagnosis.laws import Array, Law
from palpate.validation.exchange.nodal_loads import lumped_mass

# Displacements beyond so many body sizes are a blow-up.
_FAR = 10.0


class Start(Enum):
    """What the step before the first is taken for."""

    RIGHT = "a(0) + dt^2/2 a''(0)"
    NONE = "a(0)"
    DOUBLE = "a(0) + dt^2 a''(0)"


class Update(Enum):
    """The update of a step."""

    CENTRAL = "central differences"
    SEMI_IMPLICIT = "semi-implicit Euler"


@dataclass(frozen=True, eq=False)
class Slip:
    """A motion as the candidate may have understood it; the default is the problem as stated.

    Attributes:
        law: The law; None for the one asked for.
        lame: Lamé's parameters by cell; None for those asked for.
        mass: Lumped [kg], (num_points,); None for the right one.
        inverse_mass: Of a full matrix, (num_points, num_points), where it is not lumped.
        mass_factor: Of the mass.
        stiffness_factor: Of the internal force.
        load_factors: Of each load; None for 1.
        is_other_pressure: Pressures follow the surface where they should not, or the reverse.
        damping: lambda of D = lambda M [1/s]; None for what was asked.
        step_factor: Length of a step over what was asked, with as many steps.
        pieces: Steps for each that was asked.
        late: Steps that every stored state comes late.
        released: Held components that are not held.
        with_amplitudes: Whether loads and supports follow their amplitudes.
    """

    law: Law | None = None
    lame: tuple[Array, Array] | None = None
    mass: Points | None = None
    inverse_mass: Array | None = None
    mass_factor: float = 1.0
    stiffness_factor: float = 1.0
    load_factors: tuple[float, ...] | None = None
    is_other_pressure: bool = False
    damping: float | None = None
    start: Start = Start.RIGHT
    update: Update = Update.CENTRAL
    step_factor: float = 1.0
    pieces: int = 1
    late: int = 0
    released: Mask | None = None
    with_amplitudes: bool = True


@dataclass(frozen=True, eq=False)
class Stepper:
    """Steps a body's motion to its first outputs.

    Attributes:
        body: Its forces.
        step: Length of a step [s].
        per_output: Steps from output to output.
        num_outputs: How many outputs are stepped to.
    """

    body: Body
    step: float
    per_output: int
    num_outputs: int
    _mass: Points = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_mass", lumped_mass(self.body.problem))

    def outputs(self, slip: Slip) -> Iterator[Points]:
        """The state at each output after the first [m], (num_points, 3); ends at a blow-up."""
        body, span = self.body, self.body.problem.time
        assert span is not None
        dt = self.step * slip.step_factor / slip.pieces
        held = body.held if slip.released is None else body.held & ~slip.released
        damping = span.mass_damping if slip.damping is None else slip.damping
        size = float(np.ptp(body.mesh.points, axis=0).max())
        force, moved = _Forces(self.body, slip), _Supports(body, slip.with_amplitudes)
        now = np.where(held, moved(0.0), 0.0)
        acceleration = self._per_mass(force(now, 0.0), slip)
        match slip.start:
            case Start.RIGHT:
                before = now + 0.5 * dt**2 * acceleration
            case Start.NONE:
                before = now
            case Start.DOUBLE:
                before = now + dt**2 * acceleration
        left, right = 1.0 / dt**2 + damping / (2.0 * dt), 1.0 / dt**2 - damping / (2.0 * dt)
        velocity = np.zeros_like(now)
        every = self.per_output * slip.pieces
        for step in range(1, every * self.num_outputs + 1 + max(-slip.late, 0)):
            acceleration = self._per_mass(force(now, (step - 1) * dt), slip)
            if slip.update is Update.CENTRAL:
                after = (acceleration + 2.0 / dt**2 * now - right * before) / left
            else:
                velocity = velocity + dt * (acceleration - damping * velocity)
                after = now + dt * velocity
            after = np.where(held, moved(step * dt), after)
            if not np.abs(after).max() < _FAR * size:
                return
            before, now = now, after
            stored = step + slip.late
            if stored > 0 and stored % every == 0:
                yield now

    def _per_mass(self, force: Points, slip: Slip) -> Points:
        if slip.inverse_mass is not None:
            solved: Points = slip.inverse_mass @ force
            return solved
        mass = self._mass if slip.mass is None else slip.mass
        return force / (slip.mass_factor * mass[:, None])


class _Forces:
    """External less internal force [N] over time."""

    def __init__(self, body: Body, slip: Slip) -> None:
        self._body, self._slip = body, slip
        self._loads = body.problem.loads
        self._factors = slip.load_factors or (1.0,) * len(self._loads)

    def __call__(self, displacement: Points, time: float) -> Points:
        slip, body = self._slip, self._body
        total = -slip.stiffness_factor * body.internal(displacement, slip.law, slip.lame)
        for index, (load, factor) in enumerate(zip(self._loads, self._factors, strict=True)):
            if slip.with_amplitudes and load.amplitude is not None:
                factor *= load.amplitude(time)
            if factor:
                total += factor * body.load(index, displacement, is_other=slip.is_other_pressure)
        return total


class _Supports:
    """Where held components are over time [m]."""

    def __init__(self, body: Body, with_amplitudes: bool) -> None:
        self._body = body
        supports = body.problem.supports
        self._moving = [s for s in supports if s.amplitude is not None and with_amplitudes]

    def __call__(self, time: float) -> Points:
        if not self._moving:
            return self._body.prescribed
        moved: NDArray[np.float64] = self._body.prescribed.copy()
        for support in self._moving:
            assert support.amplitude is not None
            axes = np.flatnonzero(support.components)
            values = support.amplitude(time) * np.array(support.displacement)[axes]
            moved[np.ix_(support.points, axes)] = values
        return moved
