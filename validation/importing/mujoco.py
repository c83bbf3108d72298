"""A MuJoCo flex of tetrahedra: Saint-Venant-Kirchhoff, pinned, at rest under gravity.

By MuJoCo's documentation (mujoco.readthedocs.io, XML reference: flexcomp, flex, flexcomp/pin,
elasticity; "Deformable objects": the passive forces of a flex of dimension 3 are those of a
Saint-Venant-Kirchhoff body of linear tetrahedra). MuJoCo knows motion alone; a case made of it
asks for the state of rest, which time steps, dampings and integrators do not change. A flex
spreads its mass evenly over its points; a case weighs its cells.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import InputError
from palpate.meshes.files import read_mesh
from palpate.meshes.material_law import Law
from palpate.meshes.tet_mesh import signed_volumes
from palpate.validation.case.geometry import inside_folder
from palpate.validation.importing.model import Body, FixedNodes, ImportRefusedError, Model
from palpate.validation.importing.understood import harmless, left_out
from palpate.validation.importing.xml_tree import Element, PlainElement, read_xml

_OPEN = "write the model out with mj_saveLastXML, which lists every point, and import that"
# Attributes of a flexcomp that change where its points are.
_MOVED = ("quat", "axisangle", "xyaxes", "zaxis", "euler", "scale", "origin", "rigid")


def read_mujoco(path: Path) -> Model:
    """Read the one flex of an MJCF file, as flexcomp or written out.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
        FileFormatError: A file that cannot be opened.
    """
    root = read_xml(path, PlainElement)
    if root.tag != "mujoco":
        raise root.refuse(f"<{root.tag}> is no MuJoCo model; that begins with <mujoco>")
    root.mark()
    in_world = [child for world in root.each("worldbody") for child in world.children]
    flexes = [flex for section in root.each("deformable") for flex in section.each("flex")]
    gravity, has_contact = _options(root.child("option"))
    flex, bodies = _only_flex(root, in_world, flexes)
    if flexes:
        points, is_pinned, mass = written_out(flex, bodies)
        cells = _cells(flex, len(points))
    else:
        points, cells, is_pinned = _flexcomp(flex, path)
        mass = _number(flex, "mass", 1.0)
    volumes = signed_volumes(points, cells.astype(np.int32))
    # MuJoCo does not mind which way round a cell is given.
    cells[volumes < 0.0] = cells[volumes < 0.0][:, [0, 2, 1, 3]]
    volume = float(np.abs(volumes).sum())
    if not (mass > 0.0 and volume > 0.0):
        raise flex.refuse(f"a body of mass {mass:g} and volume {volume:g}")
    model = Model(
        path,
        "MuJoCo",
        points,
        cells,
        np.full((len(cells), 6), -1),
        [Body(_constants(flex), mass / volume, flex.source)],
        np.zeros(len(cells), dtype=np.int64),
        np.arange(len(points)),
        acceleration=gravity if any(gravity) else None,
        notes=["MuJoCo solves motion: the case asks for the state of rest under its loads"],
    )
    contact = flex.child("contact")
    if (contact is None or contact.word("selfcollide", "auto") != "none") and has_contact:
        model.notes.append("the body may pass through itself in the case, in MuJoCo it may not")
    if is_pinned.any():
        still = dict.fromkeys(range(3), 0.0)
        model.supports.append(FixedNodes("pinned", np.flatnonzero(is_pinned), still, flex.source))
    if model.acceleration is not None:
        if len(np.unique(cells)) < len(points):
            raise flex.refuse("a point of no element, which has its share of the mass; take it out")
        model.notes.append(
            "a flex spreads its mass evenly over its points, the case by volume over its cells: "
            "the weight is the same in all, not at each point"
        )
    model.ignored += left_out([root], harmless("mujoco"))
    return model


def _only_flex(
    root: Element, in_world: list[Element], flexes: list[Element]
) -> tuple[Element, list[Element]]:
    """The one solid flex, and the bodies of the world; nothing else may touch it."""
    found = [*(child for child in in_world if child.tag == "flexcomp"), *flexes]
    bodies = [child for child in in_world if child.tag == "body"]
    if len(found) != 1:
        raise (found[1] if found else root).refuse(
            f"{len(found)} flexes; a case has one body of tetrahedra"
        )
    for element in (*found, *bodies):
        element.mark()
    if found[0].word("dim", "2") != "3":
        raise found[0].refuse("a flex that is no solid; a case has one of dim 3")
    if bodies and not flexes:
        raise bodies[0].refuse("<body> beside the flexcomp: it may touch or fix it; take it out")
    return found[0], bodies


def _constants(flex: Element) -> dict[str, float | str]:
    edge, elasticity = flex.child("edge"), flex.child("elasticity")
    if edge is not None and (
        _number(edge, "stiffness", 0.0) or edge.word("equality", "false") != "false"
    ):
        raise edge.refuse("<edge>: springs or constraints along edges; a case has none")
    if elasticity is None or _number(elasticity, "young", 0.0) <= 0.0:
        raise (elasticity or flex).refuse("<elasticity young=...> above 0 is needed")
    return {
        "law": str(Law.SAINT_VENANT_KIRCHHOFF),
        "youngs_modulus": _number(elasticity, "young", 0.0),
        "poissons_ratio": _number(elasticity, "poisson", 0.0),
    }


def _flexcomp(
    flex: Element, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    for name in _MOVED:
        if name in flex.values:
            raise flex.refuse(f"<flexcomp {name}=...>: {_OPEN}")
    if flex.word("dof", "full") != "full":
        raise flex.refuse("<flexcomp dof=...>: not every point moves by itself")
    kind = flex.word("type", "grid")
    if kind == "direct":
        points = np.array(flex.numbers(flex.require("point")), dtype=np.float64)
        if len(points) % 3:
            raise flex.refuse("<flexcomp point=...> needs three numbers a point")
        points = points.reshape(-1, 3)
        cells = _cells(flex, len(points))
    elif kind == "gmsh":
        try:
            mesh = read_mesh(inside_folder(path.parent, flex.require("file")))
        except ImportRefusedError:
            raise
        except InputError as error:
            raise flex.refuse(str(error)) from error
        points, cells = mesh.points.copy(), mesh.cells.astype(np.int64)
    else:
        raise flex.refuse(f'<flexcomp type="{kind[:20]}">: {_OPEN}')
    points = points + np.array(flex.vector(flex.word("pos", "0 0 0")))
    is_pinned = np.zeros(len(points), dtype=bool)
    for pin in flex.each("pin"):
        numbers, ends = pin.wholes(pin.word("id")), pin.wholes(pin.word("range"))
        if len(ends) % 2:
            raise pin.refuse("<pin range=...> needs pairs of first and last")
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            if not 0 <= first <= last < len(points):
                raise pin.refuse(f"<pin range=...>: no points {first} to {last}")
            numbers += range(first, last + 1)
        for number in numbers:
            if not 0 <= number < len(points):
                raise pin.refuse(f"<pin>: no point {number}")
        is_pinned[numbers] = True
    return points, cells, is_pinned


def _cells(flex: Element, num_points: int) -> NDArray[np.int64]:
    numbers = np.array(flex.wholes(flex.require("element")), dtype=np.int64)
    if not len(numbers) or len(numbers) % 4:
        raise flex.refuse("element=... needs four numbers a tetrahedron")
    if numbers.min() < 0 or numbers.max() >= num_points:
        raise flex.refuse(f"element=... names a point outside 0..{num_points - 1}")
    return numbers.reshape(-1, 4)


def _options(option: Element | None) -> tuple[tuple[float, float, float], bool]:
    """Gravity, and whether anything touches anything."""
    flag = None if option is None else option.child("flag")
    is_on = {"gravity": True, "contact": True}
    if flag is not None:
        for name in is_on:
            flag.require_usual(name, "enable", "disable", reason="known are enable and disable")
            is_on[name] = flag.word(name, "enable") == "enable"
    gravity = (0.0, 0.0, -9.81)
    if option is not None:
        gravity = option.vector(option.word("gravity", "0 0 -9.81"))
    return gravity if is_on["gravity"] else (0.0, 0.0, 0.0), is_on["contact"]


def _number(element: Element, name: str, default: float) -> float:
    found = element.numbers(element.word(name, repr(default)))
    if len(found) != 1:
        raise element.refuse(f"<{element.tag} {name}=...> needs one number")
    return found[0]


_AXES = {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)}


def written_out(
    flex: Element, bodies: list[Element]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], float]:
    """Points, which are pinned, and the mass of all, of a <flex> below <deformable>.

    A flex spreads its mass evenly, so that each free body has that of one point.

    Raises:
        ImportRefusedError: Bodies that do more than slide along x, y and z.
    """
    if "node" in flex.values:
        raise flex.refuse("<flex node=...>: points that move by those of a coarser grid")
    positions: dict[str, tuple[float, float, float]] = {}
    masses: dict[str, float] = {}
    for body in bodies:
        name = body.require("name")
        positions[name] = body.vector(body.word("pos", "0 0 0"))
        masses[name] = _mass_of_slider(body)
    names = flex.require("body").split()
    vertices = np.array(flex.numbers(flex.word("vertex")), dtype=np.float64)
    if not len(vertices):
        vertices = np.zeros(3 * len(names))
    if len(vertices) != 3 * len(names):
        raise flex.refuse(f"{len(names)} bodies and {len(vertices) / 3:g} vertices")
    points = vertices.reshape(-1, 3)
    is_pinned = np.array([name == "world" for name in names])
    for row, name in enumerate(names):
        if name == "world":
            continue
        if name not in positions:
            raise flex.refuse(f"<flex body=...>: no body {name[:40]!r} in the world")
        points[row] += positions[name]
    used = [name for name in names if name != "world"]
    if len(set(used)) < len(used):
        raise flex.refuse("<flex body=...>: two points of one body, which then is rigid between")
    others = set(positions) - set(used)
    if others:
        raise flex.refuse(f"body {min(others)[:40]!r} is no part of the flex: it may touch it")
    if not used:
        raise flex.refuse("a flex that is pinned everywhere")
    own = np.array([masses[name] for name in used])
    # MuJoCo writes six digits.
    if np.ptp(own) > 1e-5 * own.max():
        raise flex.refuse("bodies of different mass; a case has one density")
    return points, is_pinned, float(own.mean()) * len(names)


def _mass_of_slider(body: Element) -> float:
    axes = []
    for joint in body.each("joint"):
        if joint.word("type") != "slide":
            raise joint.refuse("a joint that is no slide")
        axes.append(joint.vector(joint.word("axis", "0 0 1")))
    if len(axes) != 3 or set(axes) != _AXES:
        raise body.refuse("a point of a flex slides along x, y and z")
    inertial = body.child("inertial")
    if inertial is None:
        raise body.refuse("<body> needs <inertial mass=...>")
    inertial.require("mass")
    return _number(inertial, "mass", 0.0)
