"""Describes a case in lines of text, and warns of what looks wrong in it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.fastsim.body import Body
from palpate.fastsim.explicit_body import SAFETY
from palpate.fastsim.explicit_time_step import damped_time_step
from palpate.fastsim.springs import PatchSprings
from palpate.meshes.boundary_conditions import Support, Traction
from palpate.meshes.problem import Element, Problem, Strain
from palpate.meshes.quality import measure_quality
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.units import FORCE, LENGTH, Units
from palpate.validation.exchange.nodal_arrays import are_among, facet_areas
from palpate.validation.report.buckling import load_over_critical
from palpate.validation.report.estimates import (
    MOST_CELLS,
    STUDY,
    edge_that_would_do,
    expected_error,
    guess_errors,
    measure_thickness,
)
from palpate.validation.report.loads_and_tools import (
    inclusion_names,
    inclusions_of,
    resultant_of,
)
from palpate.validation.solving import solve
from palpate.validation.states import CandidateFailedError, State

_SMALL_ANGLE = 5.0
_NEAR_INCOMPRESSIBLE = 0.45
_LARGE_PART = 0.05
# Of the first critical load: below a tenth bending is softer by at most that.
_WORTH_SAYING = 0.1
# The missing fraction in bending above which a warning is given: smoothed tetrahedra are meant to
# be accurate; linear ones are known to be stiff, and a third is more than that.
_TOO_STIFF = {Element.SMOOTHED: 0.05, Element.LINEAR: 1.0 / 3.0}
# Layers of cells between clamps below which smoothed tetrahedra gain nothing, by measurement.
_FEW_BETWEEN = 1.5
# Usual longest sides of bodies [m]; outside this range the unit is probably another one.
_USUAL_SIZES = (5e-3, 2.0)
# A Newton solve, counted in linear solves: 3 to 12 on the built-in kidney, beam and block.
_NEWTON = 8.0
# Seconds of the reference at 20 000 unknowns; 9 s (kidney) and 40 s (beam) were measured there.
_REFERENCE_SECONDS, _REFERENCE_UNKNOWNS, _REFERENCE_POWER = 20.0, 20_000, 1.2
_REFERENCE_START = 1.0
# Bytes of a 3 x 3 block with its index, in the matrix and in what is computed from it.
_FAST_BLOCK, _REFERENCE_BLOCK = 2 * 76, 4 * 108
_BASE_BYTES = 100e6
# Number of nodes that share a cell with a node, in quadratic tetrahedra.
_QUADRATIC_NEIGHBOURS = 28


@dataclass(eq=False)
class Description:
    """The findings on a case: `lines` describe it, `warnings` say what looks wrong."""

    lines: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def say(self, what: str, text: str) -> None:
        """Add a line under a heading of a word or two."""
        self.lines.append(f"{what:<10} {text}")


def describe_case(case: Case) -> Description:
    """Read and mesh a case, and describe it before it is solved.

    Raises:
        InputError: The case cannot be used.
    """
    problem, units, about = case.problem, case.spec.units, Description()
    about.say("case", f"{case.name}: {case.title}")
    _body(about, case, problem, units)
    _material(about, case, problem)
    _what_acts(about, case, problem)
    _costs(about, problem, units)
    _misses(about, case, problem)
    _measurements(about, case)
    if not case.checks:
        about.warnings.append("no [[check]]: nothing can be judged")
    about.say("checks", f"{len(case.checks)}, {case.strain} strain")
    return about


def _measurements(about: Description, case: Case) -> None:
    """What was measured, read as a fit or a verdict would."""
    if not case.spec.measurement:
        return
    from palpate.validation.case.measurements import read_measurements

    for name, measured in read_measurements(case).items():
        size, unit = measured.unit
        largest = float(np.abs(measured.values).max()) / size
        about.say(
            "measured",
            f"{name}: {len(measured.values)} value(s), {len(measured.runs)} run(s), at most "
            f"{largest:.4g} {unit}, standard uncertainty {measured.uncertainty[0] / size:.2g}",
        )


def unusual_size(mesh: TetMesh, unit: str) -> list[str]:
    """A question where a body is of a size that hardly any has; none where its unit is metres."""
    longest = float(np.ptp(mesh.points, axis=0).max())
    if unit == "m" or _USUAL_SIZES[0] <= longest <= _USUAL_SIZES[1]:
        return []
    return [f"the body is {longest / LENGTH[unit]:.4g} {unit} long: is its file really in {unit}?"]


def _body(about: Description, case: Case, problem: Problem, units: Units) -> None:
    mesh, unit = problem.mesh, units.length
    scale = LENGTH[unit]
    quality = measure_quality(mesh)
    size = " x ".join(f"{side:.4g}" for side in np.ptp(mesh.points, axis=0) / scale)
    about.say("body", f"{size} {unit}, {mesh.volume / scale**3:.5g} {unit}3; {case.mesh.origin}")
    about.say(
        "mesh",
        f"{mesh.num_cells} cells, {mesh.num_points} points, longest edge "
        f"{quality.longest_edge / scale:.3g} {unit}, smallest dihedral angle "
        f"{quality.smallest_dihedral_deg:.1f} degrees",
    )
    about.warnings += [f"{odd} see [units]" for odd in unusual_size(mesh, case.spec.units.length)]
    clamps = [s for s in problem.supports if s.normal is None and all(s.components)]
    through = measure_thickness(
        mesh, fixed=_fixed_facets(problem.supports), clamped=_fixed_facets(clamps)
    )
    cells = f"about {through.num_cells:.2g} cell(s)"
    shape = f"{through.slenderness:.2g} times as long as high"
    about.say(
        "thickness", f"{through.length / scale:.3g} {unit} where it is thin, {cells}, {shape}"
    )
    errors = {
        element: expected_error(
            through.num_cells, through.slenderness, problem.material.poissons_ratio, element
        )
        for element in Element
    }
    shown = _by_element(errors)
    about.say("bending", f"bent across that, it misses of the displacement: {shown} (`{STUDY}`)")
    if any(errors[element] > most for element, most in _TOO_STIFF.items()):
        about.warnings.append(
            f"{cells} through the thickness, {shape}: bent across them, tetrahedra are too stiff "
            f"({shown}); make edge_length smaller"
        )
    if through.num_between is not None and through.num_between < _FEW_BETWEEN:
        about.warnings.append(
            f"about {through.num_between:.2g} layer(s) of cells between clamps that face each "
            "other: with one, smoothed tetrahedra were no nearer than linear ones (24 beside 19 % "
            "off at nu 0.49, 71 beside 55 %); with two as long as high they were within 3 %: make "
            "edge_length smaller"
        )
    if quality.smallest_dihedral_deg < _SMALL_ANGLE:
        about.warnings.append(
            f"a dihedral angle of {quality.smallest_dihedral_deg:.1f} degrees, below "
            f'{_SMALL_ANGLE:g}: explicit steps get short; try boundary = "free" in [mesh]'
        )


def _material(about: Description, case: Case, problem: Problem) -> None:
    m, units = problem.material, case.spec.units
    modulus = m.youngs_modulus / units.pascals(1.0)
    about.say(
        "material",
        f"{m.law}, E = {modulus:g} {units.stress}, nu = {m.poissons_ratio:g}, {m.density:g} kg/m3",
    )
    scale = LENGTH[units.length] ** 3
    names = inclusion_names(problem, parse_toml(case.text))
    for name, one in zip(names, inclusions_of(problem), strict=True):
        modulus = one.material.youngs_modulus / units.pascals(1.0)
        about.say(
            name,
            f"{one.num_cells} cells, {one.volume / scale:.4g} {units.length}3 "
            f"({100.0 * one.part_of(problem.mesh):.2g} % of the body), E = {modulus:g} "
            f"{units.stress}, nu = {one.material.poissons_ratio:g}",
        )
    if m.poissons_ratio > _NEAR_INCOMPRESSIBLE:
        about.warnings.append(
            f"poissons_ratio = {m.poissons_ratio:g}, above {_NEAR_INCOMPRESSIBLE:g}: linear "
            "tetrahedra lock and are too stiff; hold the truth checks against that"
        )


def _what_acts(about: Description, case: Case, problem: Problem) -> None:
    units = case.spec.units
    mesh, scale, unit = problem.mesh, LENGTH[units.length], units.length
    fixed = _fixed_facets(problem.supports)
    for number, support in enumerate(problem.supports, 1):
        area = float(facet_areas(mesh.points, support.facets).sum())
        names = "".join(
            name for name, is_fixed in zip("xyz", support.components, strict=True) if is_fixed
        )
        if support.normal is not None:
            names = f"slides along its plane, normal {_vector(support.directions[0])},"
        moved = np.array(support.displacement) / scale
        where = f"{len(support.facets)} facets, {area / scale**2:.4g} {unit}2"
        if not len(support.facets):
            where = f"{len(support.points)} point(s)"
        where += f" ({100 * area / mesh.surface_area:.0f} % of the boundary)" if area else ""
        moving = f", moved by {_vector(moved)} {unit}" if moved.any() else ""
        if support.rotation is not None:
            turned = support.rotation
            moving += (
                f", turned by {np.rad2deg(turned.angle):.4g} degrees about "
                f"{_vector(np.array(turned.axis))} through "
                f"{_vector(np.array(turned.center) / scale)} {unit}"
            )
        about.say(f"support {number}", f"{where}, {names} fixed{moving}")
    total = np.zeros(3)
    for number, load in enumerate(problem.loads, 1):
        found = resultant_of(problem, load)
        total += found.force
        force = found.force / FORCE[units.force]
        where = (
            f", {len(found.facets)} facets, {found.area / scale**2:.4g} {unit}2"
            if len(found.facets)
            else ""
        )
        if found.moment.any():
            moment = found.moment / (FORCE[units.force] * scale)
            where += f", moment {_vector(moment)} {units.force} {unit} about its middle"
        # Beyond the case's loads are the weights of its masses.
        name = f"load {number}" if number <= len(case.spec.load) else "weight"
        about.say(name, f"{found.kind} {_vector(force)} {units.force}{where}")
        num_fixed = int(are_among(found.facets, fixed).sum())
        if num_fixed and isinstance(load, Traction):
            about.warnings.append(
                f"{name} pushes {num_fixed} facet(s) that are fixed; that part is lost"
            )
    if problem.loads:
        about.say("in all", f"{_vector(total / FORCE[units.force])} {units.force}")
    for number, tool in enumerate(problem.tools, 1):
        path = tool.path
        shape = type(tool.shape).__name__.removesuffix("Shape").lower()
        ends = " to ".join(_vector(p / scale) for p in (path.positions[0], path.positions[-1]))
        about.say(f"tool {number}", f"{shape}, from {ends} {unit}")
    for number, spring in enumerate(problem.springs, 1):
        stiffness = spring.stiffness * scale / FORCE[units.force]
        about.say(
            f"spring {number}",
            f"{stiffness:.4g} {units.force}/{unit} over {len(spring.facets)} facets within "
            f"{spring.radius / scale:.4g} {unit} of {_vector(np.array(spring.center) / scale)} "
            f"{unit}, its anchor moved to {_vector(spring.path.end / scale)} {unit}",
        )
    for number, mass in enumerate(problem.masses, 1):
        area = float(facet_areas(mesh.points, mass.facets).sum()) / scale**2
        size = f"{mass.mass / units.kilograms(1.0):.4g} {units.mass}"
        over = f"over {len(mass.facets)} facets, {area:.4g} {unit}2"
        about.say(f"mass {number}", " ".join(filter(None, (mass.name, size, over))))
    is_heavy = any(load.kind == "gravity" for load in case.spec.load)
    if problem.masses and problem.time is None and not is_heavy:
        about.warnings.append(
            "a [[mass]] does nothing in statics without gravity: add a [[load]] of that kind"
        )
    moves = any(support.is_moved for support in problem.supports)
    start = problem.initial_velocity
    if start is not None:
        speed = np.array(start.velocity) / scale
        spin = np.array(start.angular_velocity)
        turning = (
            f", turning by {_vector(spin)} rad/s about "
            f"{_vector(np.array(start.center) / scale)} {unit}"
        )
        about.say("starts", f"at {_vector(speed)} {unit}/s" + (turning if spin.any() else ""))
    if not (problem.loads or problem.springs or problem.tools or moves or start is not None):
        about.warnings.append(
            "nothing pushes or moves the body: add a [[load]], a [[spring]] or a [tool]"
        )


def _costs(about: Description, problem: Problem, units: Units) -> None:
    """Report what solving will take: measured where that is quick, and guessed elsewhere."""
    mesh, span, body = problem.mesh, problem.time, Body.of(problem)
    springs = PatchSprings(mesh.points, problem.springs) if problem.springs else None
    critical = damped_time_step(
        body.critical_time_step(springs=springs), 0.0 if span is None else span.stiffness_damping
    )
    ends = mesh.cells[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
    num_edges = len(np.unique(np.sort(ends, axis=1), axis=0))
    num_nodes = mesh.num_points + num_edges
    linear: State | None = None
    trouble = fast = truth = ""
    about.say("steps", f"critical time step {critical:.3g} s")
    if span is not None:
        num_steps = math.ceil(span.end_time / (span.time_step or SAFETY * critical))
        fast = f", about {_seconds(num_steps * _seconds_of_force(body))}"
        about.lines[-1] += f"; {num_steps} explicit steps to {span.end_time:g} s"
        if span.time_step is not None and span.time_step > critical:
            about.warnings.append(
                f"time_step = {span.time_step:g} s is above the critical {critical:.3g} s: "
                "explicit steps will blow up"
            )
    else:
        ratio = 3 * num_nodes / _REFERENCE_UNKNOWNS
        seconds = _REFERENCE_START + _REFERENCE_SECONDS * ratio**_REFERENCE_POWER
        truth = f", about {_seconds(seconds)}"
        if not problem.tools:
            try:
                linear = solve(problem, strain=Strain.LINEAR)
                fast = f", about {_seconds(_NEWTON * linear.seconds)}"
            except CandidateFailedError as error:
                trouble = str(error)
    memory = _BASE_BYTES + _FAST_BLOCK * (mesh.num_points + 2 * num_edges)
    about.say("fastsim", f"{3 * mesh.num_points} unknowns{fast}, about {memory / 1e9:.1g} GB")
    memory = _BASE_BYTES + _REFERENCE_BLOCK * _QUADRATIC_NEIGHBOURS * num_nodes
    about.say(
        "truth",
        f"{3 * num_nodes} unknowns{truth}, about {memory / 1e9:.1g} GB "
        "(quadratic tetrahedra; a guess within a factor of three)",
    )
    if trouble:
        about.warnings.append(f"linear strain has no solution: {trouble}")
    if linear is None:
        return
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    moved = linear.max_displacement
    about.say(
        "linear",
        f"linear strain moves it by {moved / LENGTH[units.length]:.3g} {units.length}, "
        f"{100 * moved / size:.2g} % of its size, volume "
        f"{100 * (linear.volume / problem.mesh.volume - 1):+.2g} %",
    )
    if linear.smallest_det_f <= 0.0:
        about.warnings.append(
            "linear strain turns a cell inside out under this load: Green strain may have no "
            "equilibrium; try a smaller one"
        )
    elif moved > _LARGE_PART * size:
        about.warnings.append(
            f"linear strain moves it by {100 * moved / size:.0f} % of its size: expect Green "
            "strain to differ, and to need several Newton iterations"
        )
    elif moved == 0.0:
        about.warnings.append("nothing moves under these loads: is the loaded part fixed?")
    if moved > 0.0:
        _buckling(about, problem)


def _buckling(about: Description, problem: Problem) -> None:
    """Report the load over the first critical one, where it is within a factor of ten of it."""
    found = load_over_critical(problem)
    if found is None or found.ratio < _WORTH_SAYING:
        return
    words = f"{found.ratio:.2g} times its first critical load (linear, smoothed cells)"
    if not found.is_settled:
        words = f"{found.least:.2g} to {words}: uncertain, a mode of one edge or cell of this mesh"
    about.say("buckling", words)
    if found.least > 1.0:
        about.warnings.append(
            f"the load is {found.least:.2g} times the first critical one (linear buckling): Green "
            "strain has several equilibria, and two right solvers may find different ones; add a "
            "small load that prefers one side, or lower the load"
        )


def _misses(about: Description, case: Case, problem: Problem) -> None:
    """Report what the mesh will miss under any load, beside what the case asks for."""
    errors = guess_errors(problem)
    if errors is None:
        why = "in motion" if problem.time is not None else "under a tool" if problem.tools else ""
        is_large = problem.mesh.num_cells > MOST_CELLS
        why = why or (f"above {MOST_CELLS} cells" if is_large else "without a linear solution")
        about.say(
            "misses",
            f"no guess {why}; the rule of bending is of bending alone: what is pressed, sheared or "
            "fixed at an edge may be farther off",
        )
        return
    shown = _by_element(errors)
    about.say(
        "misses", f"{shown} of the displacement (linear strain, each cell cut in eight: a guess)"
    )
    asked = [c.limit for c in case.checks if (c.metric, c.against) == ("displacement_l2", "truth")]
    if asked and min(errors.values()) > min(asked):
        length = edge_that_would_do(min(errors.values()), min(asked))
        about.warnings.append(
            f"a check asks for {100.0 * min(asked):.2g} % of the true displacement, and no element "
            f"is expected to be that near ({shown}): edges {length:.2g} times as long may do, "
            "first of all where it is fixed"
        )


def _by_element(errors: dict[Element, float]) -> str:
    return ", ".join(f"{element} {100.0 * error:.2g} %" for element, error in errors.items())


def _fixed_facets(supports: Sequence[Support]) -> NDArray[Any]:
    """Facets of some supports, (num_facets, 3)."""
    return np.vstack([np.zeros((0, 3), dtype=np.int32), *(s.facets for s in supports)])


def _vector(values: NDArray[Any]) -> str:
    return "[" + ", ".join(f"{value + 0.0:.4g}" for value in np.round(values, 12)) + "]"


def _seconds(value: float) -> str:
    if value < 120.0:
        return f"{max(value, 0.1):.1g} s" if value < 10.0 else f"{value:.0f} s"
    return f"{value / 60.0:.0f} min" if value < 7200.0 else f"{value / 3600.0:.0f} h"


def _seconds_of_force(body: Body) -> float:
    """Time of the internal forces, which are most of a step [s]; the best of three."""
    rest = np.zeros_like(body.mesh.points)
    best = math.inf
    for _ in range(3):
        start = time.perf_counter()
        body.internal_force(rest)
        best = min(best, time.perf_counter() - start)
    return best
