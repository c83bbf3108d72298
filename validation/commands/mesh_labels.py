"""`palpate mesh LABELS --label NUMBER=NAME -o MESH`: organs from a label image."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from palpate.meshes.errors import InputError
from palpate.validation.commands.options import TISSUE, print_lines, progress_lines, step_lines
from palpate.validation.quoting import for_terminal

if TYPE_CHECKING:
    from pathlib import Path


def mesh_label_image(
    image: str,
    output: Path,
    labels: list[str],
    walls: list[str],
    smallest_island: int,
    voxel_edge: float | None,
    uniform: bool,
    time_limit: float | None,
    *,
    force: bool,
) -> None:
    """Mesh labels of an image, in mm, and print their volumes."""
    from palpate.fastsim.critical_cells import find_critical_cells
    from palpate.meshes.files import MESH_SUFFIXES, write_mesh
    from palpate.meshes.label_images import (
        PHANTOM,
        PHANTOM_WALLS,
        SUFFIXES,
        is_label_image,
        make_phantom,
        read_labels,
    )
    from palpate.meshes.problem import Material
    from palpate.meshes.tet_mesh import TetMesh, signed_volumes
    from palpate.validation.case.label_bodies import mesh_labels
    from palpate.validation.conversions import PlainUnits
    from palpate.validation.exchange.nodal_arrays import facet_areas
    from palpate.validation.output_files import require_outputs

    began = time.monotonic()
    is_phantom = image == "phantom"
    if not (is_phantom or is_label_image(image)):
        raise InputError(f"{image}: --label needs a label image: {', '.join(SUFFIXES)}")
    if output.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{output}: unknown kind; use {', '.join(MESH_SUFFIXES)}")
    if time_limit is not None and not time_limit > 0.0:
        raise InputError(f"--time-limit {time_limit:g}: needs a value above 0")
    names, around = PHANTOM, PHANTOM_WALLS
    if not is_phantom or labels:
        names = parse_labels(labels)
        around = parse_labels(walls, "--wall") if walls else {}
    numbers, called = set(names) & set(around), set(names.values()) & set(around.values())
    if numbers or called:
        twice = min(map(str, numbers or called))
        raise InputError(f"--wall {twice}: is a --label as well; a wall is not meshed")
    inputs = [] if is_phantom else [image]
    require_outputs({"--output": output}, inputs=inputs, force=force)
    read = make_phantom() if is_phantom else read_labels(image)
    say, units = progress_lines(), PlainUnits(length="mm")
    say(f"{image}: {read.line()}")

    def time_left() -> float | None:
        return None if time_limit is None else max(time_limit + began - time.monotonic(), 1e-3)

    mesh = mesh_labels(
        read,
        names,
        walls=around,
        smallest_island=smallest_island,
        voxel_edge=voxel_edge,
        uniform=uniform,
        time_left=time_left,
        progress=lambda line: say(units.in_case_units(line)),
    )
    scaled = TetMesh(mesh.points * 1e3, mesh.cells, mesh.facet_groups, cell_groups=mesh.cell_groups)
    write_mesh(output, scaled, groups=True)
    critical = find_critical_cells(mesh, Material(*TISSUE))
    print(
        for_terminal(
            f"{output}: {mesh.num_cells} cells, smallest dihedral angle "
            f"{critical.smallest_dihedral_deg:.1f} degrees, volume {mesh.volume * 1e9:.6g} mm3"
        )
    )
    for name, rows in mesh.cell_groups.items():
        volume = float(signed_volumes(mesh.points, mesh.cells[rows]).sum()) * 1e9
        print(for_terminal(f"  {name}: {len(rows)} cells, volume {volume:.6g} mm3"))
    for name, facets in mesh.facet_groups.items():
        area = float(facet_areas(mesh.points, facets).sum()) * 1e6
        print(for_terminal(f"  {name}: {len(facets)} facets, area {area:.6g} mm2"))
    print_lines(step_lines(critical, is_stated=False, scale=1e-3, unit="mm"))


def parse_labels(given: list[str], option: str = "--label") -> dict[int, str]:
    """Names by number from texts NUMBER=NAME; refuses numbers and names given twice."""
    if not given:
        raise InputError("a label image needs --label NUMBER=NAME, once for each label to mesh")
    found: dict[int, str] = {}
    for text in given:
        number, _, name = text.partition("=")
        if not (number.isascii() and number.isdigit() and int(number) > 0 and name):
            raise InputError(f"{option} {text}: needs NUMBER=NAME, with a whole number above 0")
        if int(number) in found or name in found.values():
            raise InputError(f"{option} {text}: the number or the name is there twice")
        found[int(number)] = name
    return found
