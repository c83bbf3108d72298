"""What a polyhedron leaves out of a curved body, against closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bank import made_state

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh, write_surface
from palpate.meshes.problem import Strain
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.reference.errors import ReferenceCrashedError
from palpate.validation.case import CaseError, load_case
from palpate.validation.exchange.nodal_arrays import facet_areas
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import judge_check
from palpate.validation.metrics import WHOLE_BODY_METRICS
from palpate.validation.references import geometry, true_bodies
from palpate.validation.references.bars import BarParts
from palpate.validation.references.geometry import geometry_notes, shape_of, with_geometry
from palpate.validation.references.reference_set import QUADRATIC, ReferenceSet
from palpate.validation.references.true_bodies import on_moved, true_body
from palpate.validation.states import Verdict

CASE = """
schema = 1
title = "A curved body"
strain = "linear"
{truth}
[geometry]
{geometry}

[material]
youngs_modulus = 1000.0
poissons_ratio = 0.3

[[support]]
region = {{ half_space = {{ point = [0.0, 0.0, {low}], normal = [0.0, 0.0, -1.0] }} }}

[[load]]
kind = "{kind}"
region = {{ half_space = {{ point = [0.0, 0.0, {high}], normal = [0.0, 0.0, 1.0] }} }}
{load}

[[check]]
metric = "max_displacement"
against = "truth"
limit = 0.05
reason = "what a hand feels"
"""
RADIUS, HEIGHT = 1.0, 6.0
CYLINDER = f'shape = "cylinder"\nradius = {RADIUS}\nheight = {HEIGHT}\nedge_length = 1.1'
SPHERE = 'shape = "sphere"\nradius = 1.0\nedge_length = 0.6'
PLACES = {(metric, Strain.LINEAR): 0.01 for metric in WHOLE_BODY_METRICS}


@pytest.fixture
def case_of(tmp_path):
    def write(geometry, *, truth="", kind="force", load="force = [1.0, 0.0, 0.0]", ends=(0.0, 0.0)):
        low, high = ends
        text = CASE.format(
            geometry=geometry, truth=truth, kind=kind, load=load, low=low + 1e-3, high=high - 1e-3
        )
        path = tmp_path / "curved.toml"
        path.write_text(text)
        return load_case(path)

    return write


@pytest.fixture
def cylinder(case_of):
    return case_of(CYLINDER, ends=(0.0, HEIGHT))


def references_of(problem):
    points = problem.mesh.points
    truth = made_state(problem.mesh, 0.01 * points, strain=Strain.LINEAR, degree=2)
    return ReferenceSet({(QUADRATIC, Strain.LINEAR): truth}, PLACES, "here")


def squeezed(monkeypatch):
    """Every body shrinks alike, as under a pressure all around it: u = -p (1 - 2 nu) / E x."""

    def solve(problem, strain, _degree, _progress, **_words):
        return made_state(problem.mesh, -1e-3 * problem.mesh.points, strain=strain)

    monkeypatch.setattr(geometry, "solve_state", solve)


def geometry_of(case, **words):
    found = with_geometry(
        case, references_of(case.problem), lambda _line: None, strains=[Strain.LINEAR], **words
    )
    return found, {m: found.bar_parts(m, Strain.LINEAR).geometry for m in WHOLE_BODY_METRICS}


@pytest.mark.dolfinx
def test_a_coarse_cylinder_bends_a_quarter_too_far(cylinder):
    """Timoshenko's beam: w = F L^3 / (3 E I) + F L / (k G A), k = 6 (1 + nu) / (7 + 6 nu).

    (G. R. Cowper, J. Appl. Mech. 33, 1966.) The case's polyhedron bends by 0.1309.
    """
    found, parts = geometry_of(cylinder)
    E, nu, area, inertia = 1000.0, 0.3, math.pi, math.pi / 4.0
    k = 6.0 * (1.0 + nu) / (7.0 + 6.0 * nu)
    true = HEIGHT**3 / (3.0 * E * inertia) + HEIGHT / (k * E / (2.0 * (1.0 + nu)) * area)
    expected = (0.1309 - true) / 0.1309
    assert expected == pytest.approx(0.256, abs=0.005)
    # The clamp's own stiffness and the mesh leave some per cent of the part; 1.25 is for safety.
    assert parts["max_displacement"] == pytest.approx(1.25 * expected, rel=0.05)
    assert shape_of(found) == "a cylinder"
    # The bar itself is what it was.
    assert found.bar_parts("max_displacement", Strain.LINEAR).whole == pytest.approx(0.01)
    assert dict(found.bars) == PLACES


def test_a_sphere_under_pressure_shrinks_by_its_own_volume(case_of, monkeypatch):
    """Any body does, by the same strain: changes differ as volumes and areas do, no point moves."""
    squeezed(monkeypatch)
    case = case_of(SPHERE)
    mesh = case.problem.mesh
    _, parts = geometry_of(case)
    volume = 4.0 / 3.0 * math.pi / mesh.volume - 1.0
    area = 4.0 * math.pi / mesh.surface_area - 1.0
    assert volume > 0.05
    assert parts["volume"] == pytest.approx(1.25 * volume, rel=0.1)
    assert parts["surface_area"] == pytest.approx(1.25 * area, rel=0.1)
    assert parts["displacement_max"] == parts["max_displacement"] == 0.0


@pytest.fixture
def sphere_file(tmp_path):
    write_mesh(tmp_path / "coarse.vtu", mesh_surface(shape_sphere(1.0, edge_length=0.6)))
    write_surface(tmp_path / "fine.ply", shape_sphere(1.0, edge_length=0.1))
    return 'mesh = "coarse.vtu"'


def test_a_finer_surface_says_what_a_file_leaves_out(case_of, sphere_file, monkeypatch):
    squeezed(monkeypatch)
    case = case_of(sphere_file, truth='[truth]\nsurface = "fine.ply"\n')
    assert case.folder / "fine.ply" in case.files
    found, parts = geometry_of(case)
    assert geometry_notes(case, found) == []
    missing = 4.0 / 3.0 * math.pi / case.problem.mesh.volume - 1.0
    assert parts["volume"] == pytest.approx(1.25 * missing, rel=0.1)
    assert shape_of(found) == "the surface in fine.ply"


def test_a_distance_counts_out_and_in(case_of, sphere_file, monkeypatch):
    squeezed(monkeypatch)
    case = case_of(sphere_file, truth="[truth]\ngeometry_distance = 0.02\n")
    within = true_body(case)
    assert within is not None
    # As far off as it may be: the difference is the bound, and not a part of one.
    assert (within.factor, len(within.others)) == (1.0, 2)
    _, parts = geometry_of(case)
    # Outwards is the larger: 1.02^3 - 1, by vertex normals.
    assert parts["volume"] == pytest.approx(1.02**3 - 1.0, rel=0.1)
    assert parts["displacement_max"] == pytest.approx(0.02, rel=0.05)


def test_of_a_file_alone_nobody_knows(case_of, sphere_file):
    case = case_of(sphere_file)
    assert true_body(case) is None
    untold, parts = geometry_of(case)
    (note,) = geometry_notes(case, untold)
    assert "geometry_distance in the case tells it" in note
    assert set(parts.values()) == {0.0}
    assert shape_of(untold) == ""


def test_a_truth_stored_without_its_part_says_so(case_of):
    case = case_of(SPHERE)
    old = references_of(case.problem)
    (note,) = geometry_notes(case, old)
    assert "no geometry part: what flat facets leave out of a sphere" in note
    assert "`palpate reference build curved.toml`" in note
    without = ReferenceSet({}, {}, "nowhere")
    assert geometry_notes(case, without) == []


def test_a_part_of_another_surface_is_reported(case_of, sphere_file, tmp_path, monkeypatch):
    squeezed(monkeypatch)
    reported = '[truth]\nsurface = "fine.ply"\n'
    found, _ = geometry_of(case_of(sphere_file, truth=reported))
    assert geometry_notes(case_of(sphere_file, truth=reported), found) == []
    write_surface(tmp_path / "fine.ply", shape_sphere(1.01, edge_length=0.1))
    (note,) = geometry_notes(case_of(sphere_file, truth=reported), found)
    assert "of the surface in fine.ply as it was when it was built" in note
    (note,) = geometry_notes(
        case_of(sphere_file, truth="[truth]\ngeometry_distance = 0.02\n"), found
    )
    assert "the case has a body within 0.02 m of it now" in note


def test_inclusions_are_reported(case_of):
    soft = """
[[inclusion]]
region = { ball = { center = [0.5, 0.5, 3.0], radius = 0.9 } }
material = { youngs_modulus = 1.0, poissons_ratio = 0.3 }
"""
    box = 'shape = "box"\nsize = [1.0, 1.0, 6.0]\nedge_length = 1.0'
    case = case_of(box, ends=(0.0, 6.0))
    case.path.write_text(case.text + soft)
    (note,) = geometry_notes(load_case(case.path), references_of(case.problem))
    assert note.startswith("Inclusions are the cells that the mesh gives them")


def test_flat_shapes_have_no_geometry_part(case_of):
    case = case_of('shape = "box"\nsize = [1.0, 1.0, 6.0]\nedge_length = 1.0', ends=(0.0, 6.0))
    assert true_body(case) is None
    assert geometry_notes(case, references_of(case.problem)) == []


def test_the_true_kidney_has_the_volume_of_table_one(case_of):
    case = case_of('shape = "kidney"\nedge_length = 0.02')
    body = true_body(case)
    (mesh,) = body.others
    assert mesh.volume == pytest.approx(332889e-9, rel=1e-12)
    assert mesh.num_cells == body.base.mesh.num_cells == 8 * case.problem.mesh.num_cells
    assert np.abs(mesh.points - body.base.mesh.points).max() > 1e-4


def test_a_force_keeps_its_size_and_a_moment_too(case_of):
    def moved(case):
        body = true_body(case)
        problem = on_moved(case.spec.load, case.spec.units, body.base, body.others[0])
        (load,) = problem.loads
        return problem.mesh, load

    mesh, load = moved(case_of(CYLINDER, ends=(0.0, HEIGHT)))
    force = facet_areas(mesh.points, load.facets).sum() * np.array(load.traction)
    assert force == pytest.approx([1.0, 0.0, 0.0])
    mesh, load = moved(
        case_of(CYLINDER, kind="moment", load="moment = [0.0, 0.0, 2.0]", ends=(0.0, HEIGHT))
    )
    # Affine over a facet, weighted by the points of a rule of third degree and more.
    corners = mesh.points[load.facets]
    areas = facet_areas(mesh.points, load.facets)
    middles = 0.5 * (corners + corners[:, [1, 2, 0]])
    at = middles.reshape(-1, 3)
    weights = np.repeat(areas / 3.0, 3)
    moment = (weights[:, None] * np.cross(at, load.at(at))).sum(axis=0)
    assert moment == pytest.approx([0.0, 0.0, 2.0], abs=1e-9)


def test_a_true_body_without_a_result_is_reported(cylinder, monkeypatch):
    def crash(*_args, **_words):
        raise ReferenceCrashedError(-9, "")

    monkeypatch.setattr(geometry, "solve_state", crash)
    found, parts = geometry_of(cylinder)
    assert set(parts.values()) == {math.inf}
    assert found.bar_parts("volume", Strain.LINEAR).whole == pytest.approx(0.01)
    (note,) = geometry_notes(cylinder, found)
    assert note.startswith("What a cylinder adds (linear strain) is not known: there ")


def test_a_tube_of_few_facets_is_moved_with_what_lies_inside_its_wall(case_of):
    """Moved alone, its inner facets turn cells of the wall inside out."""
    tube = 'shape = "tube"\nradius = 1.0\ninner_radius = 0.7\nheight = 1.0\nedge_length = 1.1'
    case = case_of(tube, ends=(0.0, 1.0))
    (mesh,) = true_body(case).others
    true = math.pi * (1.0 - 0.7**2)
    # Of twelve corners and of six: n / (2 pi) sin(2 pi / n).
    assert mesh.volume / true == pytest.approx(0.955, abs=0.01)
    assert case.problem.mesh.volume / true == pytest.approx(0.827, abs=0.01)
    # Its flat faces stay flat, and whole.
    ends = mesh.points[np.unique(mesh.boundary_facets)][:, 2]
    assert ends.min() == 0.0
    assert ends.max() == 1.0


def test_a_built_in_shape_too_coarse_for_its_surface_is_reported_not_refused(case_of, monkeypatch):
    def refuse(*_args):
        raise InputError("the mesh is too coarse for its true surface")

    monkeypatch.setattr(true_bodies, "refine_along", refuse)
    case = case_of(SPHERE)
    found, parts = geometry_of(case)
    assert set(parts.values()) == {math.inf}
    assert "too coarse for its true surface" in geometry_notes(case, found)[0]


def test_points_of_a_free_boundary_come_to_the_flat_faces_too(case_of):
    octant = (
        'shape = "hollow_octant"\nradius = 1.0\ninner_radius = 0.5\nedge_length = 0.4\n'
        '[mesh]\nboundary = "free"\nboundary_distance = 0.02'
    )
    case = case_of(octant, ends=(0.02, 0.98))
    (mesh,) = true_body(case).others
    points = mesh.points[np.unique(mesh.boundary_facets)]
    lengths = np.linalg.norm(points, axis=1)
    apart = np.column_stack([np.abs(points), np.abs(lengths[:, None] - [0.5, 1.0])]).min(axis=1)
    # What the facets of the finer shape leave: 0.13^2 / 8 / R.
    assert apart.max() < 0.006


@pytest.mark.parametrize(
    ("truth", "shape", "words"),
    [
        ('surface = "fine.ply"\ngeometry_distance = 0.1', "file", "not both"),
        ("geometry_distance = 0.1", "sphere", "knows its own surface"),
        ("geometry_distance = -0.1", "file", "geometry_distance"),
        ("geometry_distance = true", "file", "geometry_distance"),
    ],
)
def test_what_makes_no_sense_is_refused(case_of, sphere_file, truth, shape, words):
    geometry = sphere_file if shape == "file" else SPHERE
    with pytest.raises(CaseError, match=words):
        case_of(geometry, truth=f"[truth]\n{truth}\n")


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        ('surface = "gone.ply"', "no such file"),
        ('surface = "../fine.ply"', "outside the case's folder"),
        ('surface = "open.ply"', "open.ply"),
        ("geometry_distance = 2.0", "too coarse for its true surface"),
    ],
)
def test_surfaces_that_cannot_be_used_are_refused(case_of, sphere_file, tmp_path, truth, words):
    whole = shape_sphere(1.0, edge_length=0.6)
    write_surface(tmp_path / "open.ply", TriSurface(whole.points, whole.facets[:-3]))
    with pytest.raises(InputError, match=words):
        true_body(case_of(sphere_file, truth=f"[truth]\n{truth}\n"))


def test_geometry_counts_where_the_number_is_of_the_true_body(case_of):
    published = """
[[check]]
metric = "published_displacement"
against = "{against}"
at = [0.0, 0.0, 1.0]
component = "z"
expected = 0.008
limit = 0.01
reason = "closed form"
"""
    case = case_of(SPHERE)
    state = references_of(case.problem).truth(Strain.LINEAR)

    def judged(against):
        text = case.text + published.format(against=against)
        case.path.write_text(text)
        spec = load_case(case.path).checks[-1]
        parts = BarParts(discretisation=0.001, geometry=0.4 if against == "truth" else 0.0)
        words = {"parts": parts, "shape": "a sphere"}
        return judge_check(spec, Strain.LINEAR, case.problem, state, state, 0.001, "", **words)

    # A quarter off a number that the chords alone may be 40 % off.
    found = judged("truth")
    assert found.value == pytest.approx(0.25)
    assert found.verdict is Verdict.INCONCLUSIVE
    assert "geometry" in found.message
    assert "a polyhedron of a sphere: its geometry adds up to" in found.message
    assert "beside the bar" not in found.message
    # The candidate answered for the polyhedron.
    assert judged("candidate").verdict is Verdict.FAILED
    assert dataclasses.is_dataclass(found)


def test_a_truth_solved_here_gets_its_part_within_a_time(case_of, monkeypatch):
    limits = []
    squeezed(monkeypatch)
    solve = geometry.solve_state

    def timed(*args, time_limit, **words):
        limits.append(time_limit)
        return solve(*args, **words)

    case = case_of(SPHERE)
    monkeypatch.setattr(geometry, "solve_state", timed)
    monkeypatch.setattr("palpate.reference.availability.is_available", lambda: True)
    live = "palpate.validation.references.statics.solve_live"
    monkeypatch.setattr(live, lambda *_args, **_words: references_of(case.problem))
    found = find_references(case, live=True, progress=lambda _line: None)
    assert found.bar_parts("volume", Strain.LINEAR).geometry > 0.05
    assert shape_of(found) == "a sphere"
    assert 0.0 < min(limits) <= max(limits) <= geometry.LIVE_SECONDS
