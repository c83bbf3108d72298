"""What case.json says in words: enough to write a simulator from it and nothing else.

Held by a test in which a short program of NumPy alone, written from these words, gives the
reference's numbers.
"""

from __future__ import annotations

from collections.abc import Mapping

from palpate.meshes.problem import Strain

LAWS: Mapping[Strain, str] = {
    Strain.GREEN: "Saint-Venant-Kirchhoff: S = lmbda tr(E) I + 2 mu E, E = (F^T F - I) / 2",
    Strain.LINEAR: "linear elasticity: sigma = lmbda tr(e) I + 2 mu e, e = sym(grad u)",
}

_INTERNAL: Mapping[Strain, str] = {
    Strain.GREEN: "R_a = sum over the cells of corner a of V F S grad N_a",
    Strain.LINEAR: "R_a = sum over the cells of corner a of V sigma grad N_a",
}
_PRESSURE: Mapping[Strain, str] = {
    Strain.GREEN: (
        "It follows the surface: a facet (a, b, c) of `pressure_facets`, counter-clockwise seen "
        "from outside, gives each of its corners the force -p/6 (x_b - x_a) x (x_c - x_a), with "
        "x = X + u where its corners are now; exact on linear tetrahedra."
    ),
    Strain.LINEAR: (
        "Linear theory: it acts on the surface at rest: a facet (a, b, c) of `pressure_facets`, "
        "counter-clockwise seen from outside, gives each of its corners the force "
        "-p/6 (X_b - X_a) x (X_c - X_a)."
    ),
}

ANSWER = (
    "write one file: .npz, .vtu or .csv with `displacement` [m], (num_points, 3), in the order of "
    "the points here; or with `original_id` in another order; or .vtu with tetrahedra of its own. "
    "`positions` instead of `displacement` if you have those. Dynamic cases: .npz with "
    "`displacement` (num_times, num_points, 3) and `times` from 0 to the end, with a state at each "
    "of `time.output_times`; where there is none, cubics between your states are compared and what "
    "they may be off counts as an error bar. States between are welcome: they are looked at for "
    "inverted cells and for places that the body cannot get to in time. Optional text in .npz: "
    "`length_unit` (m, cm, mm), `case_key`, `about` (JSON: tool, version, law, "
    "`element`: linear, or smoothed as `conventions` has it; with tools "
    "`tool_forces` [N], the force on each, (num_tools, 3), in motion "
    "(num_tools, num_outputs + 1, 3) at the output times)."
)

# Every array of rest.npz: files, shape, unit, meaning. K is the number of a load, from 0.
ARRAYS: Mapping[str, Mapping[str, str]] = {
    name: {"shape": shape, "unit": unit, "meaning": meaning, "files": files}
    for name, shape, unit, files, meaning in (
        ("points", "(num_points, 3)", "m", "rest.vtu, rest.npz", "places X of the points at rest"),
        (
            "cells",
            "(num_cells, 4)",
            "-",
            "rest.vtu, rest.npz",
            "linear tetrahedra by their points, from 0; det[b - a, c - a, d - a] > 0",
        ),
        (
            "fixed",
            "(num_points, 3)",
            "-",
            "rest.vtu, rest.npz",
            "1 where that component of the point's displacement is held, 0 where it is free",
        ),
        (
            "prescribed_displacement",
            "(num_points, 3)",
            "m",
            "rest.vtu, rest.npz",
            "where a held component is held, at full size; 0 where free",
        ),
        (
            "external_force",
            "(num_points, 3)",
            "N",
            "rest.vtu, rest.npz",
            "sum of all dead loads (tractions, body forces, point forces) at full size, whatever "
            "their amplitude; without the pressure and without what tools do",
        ),
        (
            "external_force_K",
            "(num_points, 3)",
            "N",
            "rest.npz",
            "the part of external_force of load K of `loads`; there for each dead load with an "
            "amplitude of its own",
        ),
        (
            "lumped_mass",
            "(num_points,)",
            "kg",
            "rest.vtu, rest.npz",
            "a quarter of the mass of each cell of the point, inclusions counted",
        ),
        ("youngs_modulus", "(num_cells,)", "Pa", "rest.vtu, rest.npz", "E of the cell"),
        ("poissons_ratio", "(num_cells,)", "-", "rest.vtu, rest.npz", "nu of the cell"),
        ("density", "(num_cells,)", "kg/m3", "rest.vtu, rest.npz", "of the cell at rest"),
        (
            "pressure_facets",
            "(num_pressed, 3)",
            "-",
            "rest.npz",
            "pressed boundary facets, counter-clockwise seen from outside; a facet that two loads "
            "press is there twice",
        ),
        ("pressure", "(num_pressed,)", "Pa", "rest.npz", "on each of them at full size"),
        ("pressure_load", "(num_pressed,)", "-", "rest.npz", "its number in `loads`"),
        (
            "support",
            "(num_points, 3)",
            "-",
            "rest.npz",
            "number in `supports` of what holds the component, -1 where free",
        ),
    )
}

# Every key of case.json; a name with dots lies within, [] stands for each of a list.
KEYS: Mapping[str, str] = {
    "palpate_case": "version of this format",
    "name": "of the case",
    "title": "for people",
    "case_key": "SHA-256 of everything the answer depends on; send it back with the answer",
    "strain": "green or linear: which of the two laws is asked for",
    "law": "stress from strain, by cell",
    "units": "SI throughout: of every number here and in the arrays",
    "material": "of the body; by cell in the arrays, which count",
    "has_inclusions": "whether some cells have another material",
    "num_points": "number of points",
    "num_cells": "number of cells",
    "time": "null in statics",
    "time.end_time": "[s]",
    "time.time_step": "[s] of the reference on the same mesh; null where nobody takes the same",
    "time.mass_damping": "lambda in D = lambda M [1/s]",
    "time.num_outputs": "outputs after the one at 0, evenly spaced",
    "time.output_times": "[s], num_outputs + 1 of them: where the answer is compared",
    "time.starts": "displacement 0 but where a support holds another, velocity 0",
    "loads": "what pushes, in the order of their numbers",
    "loads[].kind": "Traction, BodyForce, PointForce (dead loads), or Pressure",
    "loads[].amplitude": "its factor over time, null for 1 at all times",
    "supports": "what holds, in the order of their numbers",
    "supports[].components": "whether x, y, z are held",
    "supports[].displacement": "[m], where it holds at full size",
    "supports[].amplitude": "its factor over time, null for 1 at all times",
    "tools": "rigid tools that touch the body",
    "tools[].shape": "kind and sizes [m]",
    "tools[].path": "times [s], positions [m], rotations (w, x, y, z)",
    "tools[].friction_coefficient": "[-]",
    "tools[].contact_facets": "boundary facets that may touch, by their points; none: all of them",
    "tools[].drive": "null: it keeps to its path; else direction, force [N], amplitude, mass [kg]",
    "arrays": "every array: files, shape, unit, meaning",
    "conventions": "what the equations are, in words",
    "keys": "this table",
    "answer": "what to write, and how",
}


def describe_conventions(strain: Strain) -> dict[str, str]:
    """The equations of a case in words, one sentence or a few for each topic."""
    return {
        "element": (
            "linear tetrahedra, one point of integration, V = det[b - a, c - a, d - a] / 6; "
            "grad N_a are the constant gradients of the corners' shape functions by X; "
            "H = sum over corners a of u_a (x) grad N_a, H_ij = du_i/dX_j; F = I + H; "
            "lmbda = E nu / ((1 + nu)(1 - 2 nu)), mu = E / (2 (1 + nu)) of the cell"
        ),
        "internal_force": _INTERNAL[strain],
        "smoothed_element": (
            "who says `element`: smoothed in `about` is held on the same mesh against the same "
            "tetrahedra with averaged strains: of an edge, of its cells by V / 6; of a node, the "
            "trace, of its cells by V / 4, among cells of the same E and nu. A cell's stress is "
            "2 mu times the mean over its six edges, plus lmbda times the mean over its four "
            "nodes times I; forces follow from it as above"
        ),
        "statics": (
            "F - R(u) = 0 in every free component, u = prescribed_displacement in every held one; "
            "every amplitude counts as 1; F = external_force + pressure + tools"
        ),
        "external_force": (
            "dead: it keeps its size and direction. In motion "
            "F(t) = external_force + sum over K of (factor_K(t) - 1) external_force_K, + pressure"
        ),
        "pressure": (
            f"p > 0 pushes into the body. {_PRESSURE[strain]} It is not part of external_force. "
            "p(t) = pressure times the factor of its load (pressure_load)."
        ),
        "amplitude": (
            "a factor given at knots `times` [s]: `factors`; the first before, the last after "
            "them; between two knots straight with s = (t - t_k) / (t_k+1 - t_k), or where "
            "is_smooth with 10 s^3 - 15 s^4 + 6 s^5 in the place of s"
        ),
        "supports": (
            "a held component has the displacement factor(t) prescribed_displacement, with the "
            "factor of its support (array `support`); a support without amplitude holds it from "
            "t = 0 on"
        ),
        "motion": (
            "m a'' + lambda m a' + R(a) = F(t) in every free component, m = lumped_mass, "
            "lambda = mass_damping; starts as time.starts says"
        ),
        "integrator": (
            "Checks against the truth ask nothing of the method or the step. Checks on the same "
            "mesh are held against central differences with dt = time.time_step (eq. 12 as it "
            "must read): a(t+dt) = [dt^2 (F(t) - R(a(t))) / m + 2 a(t) - (1 - lambda dt/2) "
            "a(t-dt)] / (1 + lambda dt/2), with the pressure at a(t) and t; held components are "
            "set to their place at t + dt. Start-up: a(-dt) = a(0) + dt^2/2 (F(0) - R(a(0))) / m. "
            "Outputs lie whole steps apart: end_time / num_outputs / dt of them."
        ),
        "tools": (
            "A pose takes a place y of the tool's frame to Q y + position, with Q the matrix of "
            "the unit quaternion (w, x, y, z): turning by angle about a unit axis is "
            "(cos(angle/2), sin(angle/2) axis), by the right-hand rule. Between two knots the "
            "position goes straight and the turn at a constant rate, the shorter way round "
            "(slerp); before the first and after the last it rests; statics take the last. "
            "Shapes in their frame: SphereShape, a ball about the origin; CapsuleShape, a cylinder "
            "about z with round ends, half_length from the origin to either end's centre; "
            "BoxShape, half_widths along x, y, z about the origin; PlaneShape, the half space "
            "z <= 0. The gap is the distance of a point from the shape, negative inside; it is "
            "taken at the vertices of contact_facets that are not wholly held."
        ),
        "contact": (
            "Statics: every gap >= 0, the force on the vertex along the tool's outward normal n "
            ">= 0, and 0 where the gap is above 0. Motion without friction on a path: where a step "
            "would leave a vertex inside the tool as it is at t + dt, with gap g < 0, it is moved "
            "by W n p, p = -g / (n . W n), W = dt^2 / (m (1 + lambda dt/2)) in free components "
            "and 0 in held ones. The force on the tool is minus the sum of p n; `tool_forces` are "
            "means over the steps since the output before."
        ),
    }
