"""Still pictures of a case before it is solved, and of its states and errors afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from palpate.meshes.arrays import Points
from palpate.meshes.own_files import own_path
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import outer_facets
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case import Case
from palpate.validation.case.units import LENGTH
from palpate.validation.exchange.nodal_arrays import are_among
from palpate.validation.judging.results import CaseResult
from palpate.validation.report.comparisons import (
    STRAIN_NAMES,
    comparisons_of,
    error_top,
    first_eye,
    way_to_eye,
)
from palpate.validation.report.drawing import (
    BLUE,
    GREEN,
    OCHRE,
    RED,
    TAN,
    Marks,
    Surface,
    View,
    boundary,
    draw,
    joined,
)
from palpate.validation.report.loads_and_tools import (
    MOST_ARROWS,
    arrows_around,
    inclusion_legend,
    inclusions_of,
    inside_colour,
    load_arrows,
    resultant_of,
    spring_arrows,
    tool_surface,
    tools_in_words,
)
from palpate.validation.states import State

# Number of straight lines by which a path is drawn.
_POSES = 60
_CUT = (0.35, -1.0, 0.45)
_SIDES = ((1.0, -1.3, 0.7), (-1.0, 1.3, -0.7))
# A scale of errors ends at the largest one: its dark end says nothing of a verdict.
_NO_LIMIT = "\ndarkest: the largest here, no limit"
# Opacity of surfaces that one sees through.
_PALE = 0.35


def draw_case(case: Case, path: Path) -> None:
    """Write a picture of a case as .png; an existing file is replaced."""
    picture = draw({"case": _case_views(case)})["case"]
    with own_path(path) as temporary:
        temporary.write_bytes(picture)


def _case_views(case: Case) -> list[View]:
    """Views of the case from two sides, in its unit of length."""
    problem, unit = case.problem, case.spec.units.length
    scale = LENGTH[unit]
    points = problem.mesh.points / scale
    loads = [resultant_of(problem, load) for load in problem.loads]
    surfaces = _boundary(problem, points)
    marks, legend = _points_of_supports(problem, points), []
    if problem.supports:
        legend.append(("fixed", BLUE))
    inside = [
        (words, to_hex(colour))
        for words, colour in inclusion_legend(problem, case.spec.units, parse_toml(case.text))
    ]
    if inside:
        legend += [*inside, ("the rest of the body", TAN)]
    marks += _ways_of_supports(problem, points, scale)
    if any(support.normal is not None for support in problem.supports):
        legend.append(("arrows on it: fixed along these alone, it slides across them", BLUE))
    if any(support.rotation is not None for support in problem.supports):
        legend.append(("line: axis of a support that turns", BLUE))
    if problem.initial_velocity is not None:
        marks.append(_velocities(problem, points))
        legend.append(("velocity at the start", GREEN))
    if loads:
        marks += _arrows(load_arrows(problem, scale))
        what = "the whole force of a load"
        if any(load.spread is not None for load in loads):
            what += ", or many the force per area where it varies"
        legend.append((f"pushed or pulled; an arrow is {what}", RED))
    if problem.springs:
        marks += _arrows(spring_arrows(problem.springs, points, scale))
        legend.append(("spring over a patch; an arrow is its anchor's way", RED))
    if problem.tools:
        legend.append(("tool, pale where it starts", OCHRE))
        for tool in problem.tools:
            times = np.linspace(tool.path.times[0], tool.path.times[-1], _POSES)
            path = np.array([tool.path.pose_at(float(time))[0] for time in times])
            marks.append(Marks(path / scale, "black", is_path=True))
        surfaces += _tools(problem, scale, at_end=False)
        surfaces += _tools(problem, scale, at_end=True, opacity=1.0)
    size = " x ".join(f"{side:.4g}" for side in np.ptp(points, axis=0))
    cut = [_cut_open(problem, points, [colour for _, colour in inside])] if inside else []
    return [
        View(f"{case.name}: {case.title}", surfaces, _SIDES[0], marks, unit, legend),
        View(f"{size} {unit}, from the other side and below", surfaces, _SIDES[1], marks),
        *cut,
    ]


def _cut_open(problem: Problem, points: Points, colours: Sequence[str]) -> View:
    """The body without the cells before a plane, in the colours of its materials.

    The plane goes through the middle of the smallest inclusion, across the viewing direction of
    the first view.
    """
    mesh = problem.mesh
    smallest = min(inclusions_of(problem), key=lambda one: one.volume)
    middles = points[mesh.cells].mean(axis=1)
    depth = middles @ np.array(_CUT)
    behind = depth < float((points[np.unique(smallest.facets)] @ np.array(_CUT)).mean())
    material = np.full(mesh.num_cells, -1)
    for k, one in enumerate(problem.inclusions):
        material[one.cells] = k
    facets, row = outer_facets(mesh.cells[behind], mesh.num_points)
    shown = material[behind][row]
    surfaces = [
        Surface(points, facets[shown == k], TAN if k < 0 else colours[k])
        for k in np.unique(shown).tolist()
    ]
    return View("cut open", surfaces, _CUT)


def _boundary(problem: Problem, points: Points) -> list[Surface]:
    """The body at rest, with fixed and loaded facets in their own colours.

    Inclusions are seen through it: then it is pale. Where they are its boundary they have its
    colours.
    """
    fixed = joined([support.facets for support in problem.supports])
    pushed = joined([getattr(by, "facets", None) for by in (*problem.springs, *problem.loads)])
    body = boundary(points, problem.mesh.boundary_facets, fixed, pushed)
    inside = inclusions_of(problem)
    if not inside:
        return body
    outer = problem.mesh.boundary_facets
    inner = [
        Surface(points, one.facets[~are_among(one.facets, outer)], to_hex(inside_colour(k)))
        for k, one in enumerate(inside)
    ]
    return [*(replace(part, opacity=_PALE) for part in body), *inner]


def _arrows(pairs: Points) -> list[Marks]:
    return [Marks(pairs[:, 0], RED, vectors=pairs[:, 1])] if len(pairs) else []


def _points_of_supports(problem: Problem, points: Points) -> list[Marks]:
    """Points of supports that have no facets."""
    single = [support.points for support in problem.supports if not len(support.facets)]
    return [Marks(points[np.concatenate(single)], BLUE)] if single else []


def _ways_of_supports(problem: Problem, points: Points, scale: float) -> list[Marks]:
    """Normals of supports that slide, and axes of supports that turn."""
    reach = float(np.ptp(points, axis=0).max())
    found = []
    for support in problem.supports:
        if support.normal is not None:
            rows = support.points[:: -(-len(support.points) // MOST_ARROWS)]
            arrow = 0.08 * reach * support.directions
            vectors = np.repeat(arrow, len(rows), axis=0)
            found.append(Marks(points[rows] - vectors, BLUE, vectors=vectors))
        if support.rotation is not None:
            middle, axis = np.array(support.rotation.center) / scale, support.rotation.axis
            ends = 0.4 * reach * np.outer([-1.0, 1.0], axis)
            found.append(Marks(middle + ends, BLUE, is_path=True))
    return found


def _velocities(problem: Problem, points: Points) -> Marks:
    """The initial velocity at some boundary points; the fastest arrow is a fifth of the body."""
    assert problem.initial_velocity is not None
    outer = np.unique(problem.mesh.boundary_facets)
    rows = outer[:: -(-len(outer) // MOST_ARROWS)]
    speed = problem.initial_velocity.at(problem.mesh.points[rows])
    largest = float(np.linalg.norm(speed, axis=1).max()) or 1.0
    reach = float(np.ptp(points, axis=0).max())
    return Marks(points[rows], GREEN, vectors=0.2 * reach / largest * speed)


def _tools(
    problem: Problem, scale: float, *, at_end: bool, opacity: float = _PALE, driven: bool = True
) -> list[Surface]:
    """Tools at the start or end of their paths, in a unit of `scale` metres."""
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    found = []
    for tool in problem.tools:
        if driven or tool.drive is None:
            own, facets = tool_surface(tool, size)
            position, turn = tool.path.pose_at(float(tool.path.times[-1 if at_end else 0]))
            points = (own @ turn.T + position) / scale
            beside = not driven
            found.append(Surface(points, facets, OCHRE, opacity=opacity, is_beside=beside))
    return found


def draw_pictures(result: CaseResult, folder: Path, form: str = "png") -> dict[str, Path]:
    """Draw the states and the errors of a case, from the first direction of the 3-D view.

    Returns the path of each picture, by name ("states", "errors"); for the form see `drawing.draw`.
    """
    made = {}
    for name, picture in draw(result_views(result), form).items():
        made[name] = folder / f"{result.name}-{name}.{form}"
        made[name].write_bytes(picture)
    return made


def result_views(result: CaseResult) -> dict[str, list[View]]:
    """Views of the boundary, its states and their errors, in the case's unit of length.

    One candidate has both strain measures; several have Green strain and the best reference.
    """
    problem, states = result.problem, result.states
    scale, unit = result.units.of("length")
    points, facets = problem.mesh.points / scale, problem.mesh.boundary_facets
    green = [pairs for pairs in comparisons_of(result) if pairs.strain is Strain.GREEN]
    candidates = [state for state in states if not state.is_reference]
    several = len(result.candidates) > 1
    if several:
        shown = [state for state in candidates if state.strain is Strain.GREEN]
        shown += [states[k] for pairs in green[:1] for k in pairs.references]
    else:
        shown = sorted(candidates, key=lambda state: state.strain is Strain.GREEN)
    lengths = [np.linalg.norm(state.displacement / scale, axis=1) for state in shown]
    largest = max((float(of.max()) for of in lengths), default=1.0)
    x, y, z = way_to_eye(*first_eye(result))
    side = (float(x), float(y), float(z))
    marks = _arrows(arrows_around(problem, np.zeros(3), scale))
    started, ended = (
        _tools(problem, scale, at_end=at_end, driven=False) for at_end in (False, True)
    )
    fixed = joined([support.facets for support in problem.supports])
    original = Surface(points, facets, GREEN, is_outline=True)

    def around(moved: Points) -> list[Surface]:
        return [Surface(moved, fixed, BLUE, is_outline=True), *ended]

    said = ["blue: fixed"] if problem.supports else []
    said += ["red: pushed or pulled"] if problem.loads or problem.springs else []
    said += ["inside: other materials"] if problem.inclusions else []
    said += [f"tool: {words}" for words in tools_in_words(problem, result.units)[:1]]
    views = [
        View(
            f"original ({', '.join(said)})" if said else "original",
            [*_boundary(problem, points), *started],
            side,
            [*marks, *_points_of_supports(problem, points)],
        )
    ]
    for state, length in zip(shown, lengths, strict=True):
        moved = points + state.displacement / scale
        coloured = Surface(
            moved, facets, values=length, values_name=f"displacement [{unit}]", largest=largest
        )
        title = f"{state.label if several else STRAIN_NAMES[state.strain]} (green line: at rest)"
        views.append(View(title, [coloured, original, *around(moved)], side, marks))
    errors = []
    # The same mesh, then the best truth, which comes first of all.
    kinds = ([pairs for pairs in green if pairs.is_truth is kind][:1] for kind in (False, True))
    for pairs in chain(*kinds):
        compared = [(states[one], states[other]) for one, other in pairs.pairs]
        wrong = [np.linalg.norm(a.displacement - b.displacement, axis=1) for a, b in compared]
        # Errors that are compared with the same kind of reference have one scale.
        name = f"error [{unit}]{_NO_LIMIT}"
        top = error_top(result, max(float(length.max()) for length in wrong)) / scale
        for (one, other), length in zip(compared, wrong, strict=True):
            moved = points + one.displacement / scale
            coloured = Surface(
                moved,
                facets,
                values=length / scale,
                values_name=name,
                largest=top,
                colours="magma_r",
            )
            title = _error_title(one, other)
            errors.append(View(title, [coloured, *around(moved)], side, marks))
    return {"states": views} | ({"errors": errors} if errors else {})


def _error_title(one: State, other: State) -> str:
    return f"{one.label}: error against {other.label}"


def first_view(result: CaseResult) -> tuple[View, str] | None:
    """The body with its error, what fixes and what loads it, for the first screen, and its words.

    The error is that of the first comparison (the truth's where there is one), of the candidate
    that is farthest off; None where nothing was compared.
    """
    compared = comparisons_of(result)
    if not compared:
        return None
    states = result.states
    one, other = max(
        compared[0].pairs,
        key=lambda pair: float(
            np.abs(states[pair[0]].displacement - states[pair[1]].displacement).max()
        ),
    )
    shown, against = states[one], "the truth" if compared[0].is_truth else "the same mesh solved"
    name = _error_title(shown, states[other])
    view = next(v for v in result_views(result)["errors"] if v.title == name)
    legend = [("fixed", BLUE)] if result.problem.supports else []
    legend += [("pushed or pulled", RED)] if result.problem.loads or result.problem.springs else []
    legend += [("tool", OCHRE)] if result.problem.tools else []
    # What is fixed has no error: its colour says what it is, in the place of a value.
    fixed = joined([support.facets for support in result.problem.supports])

    def as_shown(part: Surface) -> Surface:
        if part.values is not None:
            own = part.facets[~are_among(part.facets, fixed)]
            # Its words say what the dark end is.
            return replace(part, facets=own, values_name=part.values_name.removesuffix(_NO_LIMIT))
        return replace(part, is_outline=False) if part.is_outline else part

    surfaces = [as_shown(part) for part in view.surfaces]
    words = f"{shown.label}, {STRAIN_NAMES[shown.strain]}: distance of each point from {against}."
    words += " The darkest colour is the largest distance here, not a limit."
    if tools := tools_in_words(result.problem, result.units):
        words += f" Tool: {'; '.join(tools)}."
    return replace(view, surfaces=surfaces, title="", legend=legend), words
