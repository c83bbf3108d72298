"""Inclusions from surfaces: from files to a mesh with groups, and to an answer of both solvers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.meshes.errors import InputError
from palpate.meshes.files import read_mesh, write_surface
from palpate.meshes.problem import Strain
from palpate.meshes.shapes import shape_box, shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case import load_case
from palpate.validation.cli import app
from palpate.validation.judging.judge import judge_case
from palpate.validation.states import Verdict

Write = Callable[..., Path]
TUMOUR = shape_sphere(0.3, edge_length=0.3)
PLACED = TriSurface(TUMOUR.points + np.array([0.9, 0.5, 0.5]), TUMOUR.facets)
INCLUSION = """[[inclusion]]
surface = "tumour.off"
material = { youngs_modulus = 5000.0, poissons_ratio = 0.4 }

[[support]]"""


def case_with_tumour(write_case: Write, folder: Path, *changes: tuple[str, str]) -> Path:
    write_surface(folder / "tumour.off", PLACED)
    return write_case(("[[support]]", INCLUSION), *changes)


def test_the_cells_within_the_surface_have_its_material(write_case: Write, tmp_path: Path) -> None:
    case = load_case(case_with_tumour(write_case, tmp_path))
    mesh = case.problem.mesh
    (inclusion,) = case.problem.inclusions
    assert inclusion.material.youngs_modulus == 5000.0
    volume = mesh.cell_volumes[inclusion.cells].sum()
    assert volume == pytest.approx(PLACED.volume, rel=1e-12)
    assert mesh.volume == pytest.approx(2.0, rel=1e-12)
    assert tmp_path / "tumour.off" in case.files
    assert "of inclusion 1" in case.mesh.origin


def test_what_does_not_go_with_it_is_refused(write_case: Write, tmp_path: Path) -> None:
    def refused(*changes: tuple[str, str]) -> str:
        with pytest.raises(InputError) as caught:
            load_case(case_with_tumour(write_case, tmp_path, *changes)).problem  # noqa: B018
        return str(caught.value)

    both = 'surface = "tumour.off"\nregion = { group = "x" }'
    assert "either a region or a surface" in refused(('surface = "tumour.off"', both))
    assert "do not go with them" in refused(("[material]", '[mesh]\nmesher = "gmsh"\n[material]'))
    assert "no such file" in refused(('"tumour.off"', '"none.off"'))
    shape = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
    small = shape.replace("[2.0, 1.0, 1.0]", "[2.0, 1.0, 0.5]")
    said = refused((shape, small))
    assert "body and tumour.off cut each other" in said
    assert "of body and facet " in said
    millimetres = ("[geometry]", '[units]\nlength = "mm"\n[geometry]')
    assert ") mm" in refused((shape, small), millimetres)


@pytest.mark.dolfinx
def test_both_solvers_agree_on_two_materials(write_case: Write, tmp_path: Path) -> None:
    case = load_case(case_with_tumour(write_case, tmp_path))
    result = judge_case(case, live=True)
    same = [c for c in result.checks if c.metric == "displacement_l2"]
    assert same
    assert {c.verdict for c in same} == {Verdict.PASSED}
    assert {c.strain for c in same} <= set(Strain)


def test_the_command_makes_groups_in_the_files_own_numbers(tmp_path: Path) -> None:
    body = shape_box((2.0, 1.0, 1.0), edge_length=0.5)
    organ = TriSurface(37.1 * body.points, body.facets)
    tumour = TriSurface(37.1 * PLACED.points, PLACED.facets)
    for name, surface in (("organ", organ), ("tumour", tumour)):
        write_surface(tmp_path / f"{name}.off", surface)
    words = ["mesh", str(tmp_path / "organ.off"), "-o", str(tmp_path / "out.vtu")]
    within = f"tumour={tmp_path / 'tumour.off'}"
    done = CliRunner().invoke(app, [*words, "--inclusion", within])
    assert done.exit_code == 0, done.output
    mesh = read_mesh(tmp_path / "out.vtu")
    assert set(mesh.cell_groups) == {"body", "tumour"}
    found = mesh.cell_volumes[mesh.cell_groups["tumour"]].sum()
    assert found == pytest.approx(tumour.volume, rel=1e-12)
    there = {p.tobytes() for p in mesh.points + 0.0}
    assert {p.tobytes() for p in np.vstack([organ.points, tumour.points]) + 0.0} <= there
    for wrong, why in (("tumour", "NAME=FILE"), (f"body={within}", "is taken")):
        bad = CliRunner().invoke(app, [*words, "--inclusion", wrong])
        assert why in f"{bad.output}{bad.exception}"
