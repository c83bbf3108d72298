"""Organs from label images: orientation, walls, volumes, groups, and what is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from palpate.fastsim.critical_cells import find_critical_cells
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.files import read_mesh
from palpate.meshes.label_images import (
    PHANTOM,
    PHANTOM_WALLS,
    LabelImage,
    choose_labels,
    coarsen,
    make_phantom,
    read_labels,
)
from palpate.meshes.label_surfaces import make_surfaces, separate_touching
from palpate.meshes.problem import Material
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.case.body_schema import InclusionSpec
from palpate.validation.case.label_bodies import mesh_labels
from palpate.validation.case.load import load_case
from palpate.validation.cli import app

nibabel = pytest.importorskip("nibabel")
itk = pytest.importorskip("SimpleITK")
pytest.importorskip("vtkmodules.vtkFiltersCore")

# Voxels of 1 x 1 x 2 mm, the first axis to the left.
AFFINE = np.array([[-1.0, 0, 0, 10], [0, 1, 0, -20], [0, 0, 2, 30], [0, 0, 0, 1]])
OPTIONS = [part for n, name in PHANTOM.items() for part in ("--label", f"{n}={name}")]


def nifti(path: Path, values: NDArray[np.generic], affine: NDArray[np.float64] = AFFINE) -> Path:
    nibabel.save(nibabel.Nifti1Image(values, affine), path)
    return path


def test_two_organs_a_vessel_and_a_tumour_are_one_mesh(tmp_path: Path) -> None:
    labels = make_phantom(32).labels
    path = nifti(tmp_path / "labels.nii.gz", labels.astype(np.uint8))
    output = tmp_path / "organ.vtu"
    done = CliRunner().invoke(app, ["mesh", str(path), *OPTIONS, "-o", str(output)])
    assert done.exit_code == 0, done.output
    mesh = read_mesh(output)
    assert set(mesh.cell_groups) == set(PHANTOM.values())
    for number, name in PHANTOM.items():
        rows = mesh.cells[mesh.cell_groups[name]]
        wanted = 2.0 * (labels == number).sum()  # a voxel has 1 x 1 x 2 mm3
        assert float(signed_volumes(mesh.points, rows).sum()) == pytest.approx(wanted, rel=0.01)
        centre = np.argwhere(labels == number).mean(axis=0)
        there = AFFINE[:3, :3] @ centre + AFFINE[:3, 3]
        # Half a voxel's longest edge: positions are those of the file, in its orientation.
        np.testing.assert_allclose(mesh.points[np.unique(rows)].mean(axis=0), there, atol=1.0)
    # A wall between two labels has points of both.
    shared = [np.unique(mesh.cells[mesh.cell_groups[n]]) for n in ("liver", "spleen")]
    assert len(np.intersect1d(*shared)) > 100


def test_walls_move_by_half_a_voxel_at_most_and_keep_volumes() -> None:
    image = LabelImage(make_phantom(32).labels, AFFINE)
    found = make_surfaces(image)
    points = found.smoothed(np.ones(len(found.corners)))
    moved = np.linalg.norm(points - found.corners, axis=1)
    assert 0.2 < moved.max() <= 0.5 + 1e-6  # float32 of vtk at 64 mm
    for number in PHANTOM:
        wanted = 2.0 * (image.labels == number).sum()
        assert found.volume(number, points) == pytest.approx(wanted, rel=1e-2)


def test_coarse_voxels_have_the_label_that_fills_most_of_them() -> None:
    labels = np.zeros((5, 4, 2), np.int32)
    labels[:2] = 1  # a whole voxel of 2 x 2 x 2 and another
    labels[2, :2, :] = 2  # half of a voxel: no more than nothing, which stays
    labels[2, 2:, :] = 2
    labels[3, 3, :] = 2  # three quarters
    affine = np.diag([1.0, 1.0, 3.0, 1.0])
    coarse = coarsen(LabelImage(labels, affine), 2.0)
    # 3 mm are nearer to 2 mm than 6 mm; the fifth voxel alone fills half of the last.
    np.testing.assert_array_equal(coarse.labels[:, :, 0], [[1, 1], [0, 2], [0, 0]])
    assert coarse.labels.shape == (3, 2, 2)
    np.testing.assert_allclose(coarse.affine @ [0, 0, 0, 1], [0.5, 0.5, 0.0, 1.0])
    np.testing.assert_allclose(coarse.spacing, [2.0, 2.0, 3.0])
    with pytest.raises(InputError, match=r"label\(s\) 2: thinner than voxels of 4 x 4 x 3 mm"):
        coarsen(LabelImage(labels, affine), 4.0)


def test_a_coarse_mesh_of_labels_has_the_volumes_of_the_image() -> None:
    image = make_phantom(48)
    meshes = [
        mesh_labels(image, PHANTOM, voxel_edge=edge, progress=lambda _: None) for edge in (4.0, 8.0)
    ]
    assert meshes[1].num_cells < 0.4 * meshes[0].num_cells
    for mesh in meshes:
        for number, name in PHANTOM.items():
            volume = float(signed_volumes(mesh.points, mesh.cells[mesh.cell_groups[name]]).sum())
            wanted = 8e-9 * (image.labels == number).sum()  # voxels of 2 mm
            assert volume == pytest.approx(wanted, rel=0.01)


def test_points_that_slide_onto_each_other_make_no_sliver() -> None:
    # Of voxels of 6 mm, two points came within 5 um of each other where labels meet.
    lines: list[str] = []
    mesh = mesh_labels(
        make_phantom(), PHANTOM, walls=PHANTOM_WALLS, voxel_edge=6.0, progress=lines.append
    )
    assert any("facets would be too thin" in line for line in lines)
    found = find_critical_cells(mesh, Material(1e4, 0.45, 1000.0))
    # 0.16 degrees, and a step of 1.9 um over the wave speed, where such points stay.
    assert found.smallest_dihedral_deg > 10.0
    assert found.time_step * found.wave_speed > 0.02 * 6e-3


def test_facets_that_touch_a_label_that_is_not_meshed_are_a_group() -> None:
    labels = np.zeros((8, 6, 6), np.int32)
    labels[1:4, 1:5, 1:5] = 1
    labels[4:7, 1:5, 1:5] = 5
    mesh = mesh_labels(
        LabelImage(labels, np.eye(4)), {1: "liver"}, walls={5: "spine"}, progress=lambda _: None
    )
    facets = mesh.facet_groups["spine"]
    # Between voxels 3 and 4, whose middles are at 3 and 4 mm, but for smoothing at the rim.
    assert np.ptp(mesh.points[facets][..., 0]) < 0.5e-3
    assert mesh.points[facets][..., 0].mean() == pytest.approx(3.5e-3, abs=0.2e-3)
    assert len(facets) > 20
    outer = {tuple(row) for row in np.sort(mesh.boundary_facets, axis=1).tolist()}
    assert {tuple(row) for row in np.sort(facets, axis=1).tolist()} < outer
    assert mesh.volume == pytest.approx(48e-9, rel=0.01)  # 3 x 4 x 4 voxels
    labels[4, :, :] = 0
    apart = LabelImage(labels, np.eye(4))
    with pytest.raises(InputError, match="wall far: touches none"):
        mesh_labels(apart, {1: "liver"}, walls={5: "far"}, progress=lambda _: None)


@pytest.mark.parametrize("second", [(3, 3, 2), (3, 3, 3)])
def test_voxels_that_touch_at_an_edge_or_a_corner_are_separated(second: tuple[int, ...]) -> None:
    labels = np.zeros((6, 6, 6), np.int32)
    labels[2, 2, 2] = labels[second] = 1
    clean, changed = separate_touching(labels)
    assert 1 <= changed <= 4
    around = make_surfaces(LabelImage(clean, np.eye(4))).around(1)
    edges = np.sort(np.vstack([around[:, [0, 1]], around[:, [1, 2]], around[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_separated_labels_touch_over_faces_alone() -> None:
    labels = make_phantom(24).labels
    rough = np.random.default_rng(0).random(labels.shape) < 0.01
    clean, changed = separate_touching(np.where(rough, 0, labels).astype(np.int32))
    assert changed > 0
    assert separate_touching(clean)[1] == 0


def test_a_label_that_touches_nothing_is_a_body_and_small_islands_are_named() -> None:
    labels = np.zeros((24, 12, 12), np.int32)
    labels[2:8, 3:9, 3:9] = 1
    labels[14:20, 3:9, 3:9] = 2
    labels[10:12, 5:7, 5:7] = 2
    lines: list[str] = []
    mesh = mesh_labels(LabelImage(labels, np.eye(4)), {1: "a", 2: "b"}, progress=lines.append)
    assert set(mesh.cell_groups) == {"a", "b"}
    assert any("1 island(s) of fewer than 27 voxels, at (10, 5, 5) mm" in line for line in lines)


@pytest.mark.parametrize("suffix", [".nrrd", ".mha"])
def test_other_formats_have_the_positions_of_nifti(tmp_path: Path, suffix: str) -> None:
    labels = make_phantom(8).labels
    image = itk.GetImageFromArray(labels.T.astype(np.uint8))
    image.SetSpacing((1.0, 1.0, 2.0))
    image.SetDirection((1, 0, 0, 0, -1, 0, 0, 0, 1))  # of ITK: x to the left, y to the back
    image.SetOrigin((-10.0, 20.0, 30.0))
    path = tmp_path / f"labels{suffix}"
    itk.WriteImage(image, str(path))
    read = read_labels(path)
    np.testing.assert_array_equal(read.labels, labels)
    np.testing.assert_allclose(read.affine, AFFINE, rtol=0, atol=1e-12)
    assert "axes towards LAS" in read.line()


def test_what_is_no_label_image_is_refused_with_a_remedy(tmp_path: Path) -> None:
    labels = make_phantom(16).labels.astype(np.uint8)
    sheared = AFFINE.copy()
    sheared[0, 1] = 0.3
    bad = {
        "segment it first": nifti(tmp_path / "a.nii", labels + np.float32(0.5)),
        "take one volume": nifti(tmp_path / "b.nii", np.stack([labels] * 2, axis=3)),
        "axes at right angles": nifti(tmp_path / "c.nii", labels, sheared),
        "there is no such file": tmp_path / "d.nii",
    }
    whole = nifti(tmp_path / "whole.nii.gz", labels).read_bytes()
    bad["cut off"] = tmp_path / "e.nii.gz"
    bad["cut off"].write_bytes(whole[: len(whole) // 2])
    for words, path in bad.items():
        with pytest.raises(FileFormatError, match=words):
            read_labels(path)


def test_a_huge_image_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.mhd"
    path.write_text(
        "ObjectType = Image\nNDims = 3\nDimSize = 4000 4000 4000\nElementType = MET_UCHAR\n"
        "ElementDataFile = huge.raw\n"
    )
    with pytest.raises(FileFormatError, match="crop it"):
        read_labels(path)


def test_a_label_that_is_not_there_is_refused_with_those_that_are() -> None:
    image = LabelImage(make_phantom(16).labels, np.eye(4))
    with pytest.raises(
        InputError, match=r"no voxel has the label 9 \(bone\); there are 1, 2, 3, 4, 5"
    ):
        choose_labels(image, {9: "bone"})


def test_options_that_do_not_go_with_labels_are_refused(tmp_path: Path) -> None:
    path = nifti(tmp_path / "l.nii", make_phantom(16).labels.astype(np.uint8))
    out = ["-o", str(tmp_path / "o.vtu")]
    for options, words in (
        ([], "needs --label NUMBER=NAME"),
        (["--label", "x=liver"], "whole number above 0"),
        (["--label", "1=a", "--label", "1=b"], "there twice"),
        (["--label", "1=a", "--wall", "1=b"], "is a --label as well"),
        (["--label", "1=a", "--repair"], "--repair does not go with a label image"),
    ):
        done = CliRunner().invoke(app, ["mesh", str(path), *options, *out])
        assert isinstance(done.exception, InputError)
        assert words in str(done.exception)


def test_an_inclusion_is_a_region_a_surface_or_a_label() -> None:
    table = tomllib.loads("material = {youngs_modulus = 1e4, poissons_ratio = 0.4}")
    assert InclusionSpec.model_validate({**table, "label": "tumour"}).label == "tumour"
    with pytest.raises(ValueError, match="exactly one of region, surface, label"):
        InclusionSpec.model_validate({**table, "label": "tumour", "surface": "a.stl"})


def test_a_case_gives_each_label_its_material(tmp_path: Path) -> None:
    labels = np.zeros((8, 6, 6), np.int32)
    labels[1:4, 1:5, 1:5] = 1
    labels[4:7, 1:5, 1:5] = 2
    path = nifti(tmp_path / "l.nii", labels.astype(np.uint8), np.eye(4))
    words = ["mesh", str(path), "--label", "1=liver", "--label", "2=tumour"]
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "organ.vtu")])
    assert done.exit_code == 0, done.output
    (tmp_path / "case.toml").write_text(CASE)
    problem = load_case(tmp_path / "case.toml").problem
    (tumour,) = problem.inclusions
    assert tumour.material.youngs_modulus == 3e4
    np.testing.assert_array_equal(tumour.cells, problem.mesh.cell_groups["tumour"])
    (tmp_path / "case.toml").write_text(CASE.replace('"tumour"', '"cyst"'))
    with pytest.raises(InputError, match="no group of cells 'cyst'"):
        load_case(tmp_path / "case.toml").problem  # noqa: B018


CASE = """
schema = 1
title = "Labels"
strain = "green"
[units]
length = "mm"
[geometry]
mesh = "organ.vtu"
[material]
youngs_modulus = 5e3
poissons_ratio = 0.4
[[inclusion]]
label = "tumour"
material = {youngs_modulus = 3e4, poissons_ratio = 0.4}
[[support]]
region = {half_space = {point = [1.0, 0, 0], normal = [-1.0, 0, 0]}}
[[check]]
metric = "displacement_l2"
against = "same_mesh"
limit = 1e-8
reason = "a test"
[[load]]
kind = "gravity"
acceleration = [0.0, 0.0, -9.81]
"""
