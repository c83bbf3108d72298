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
from palpate.validation.importing.xml_tree import Element, read_xml

# Parts of a model that no equilibrium depends on: how it is made, looks and is solved.
_HARMLESS = ("compiler", "size", "visual", "statistic", "asset", "default", "custom", "sensor")
_FORCEFUL = ("actuator", "equality", "tendon", "contact", "extension", "keyframe", "include")
_OPEN = "write the model out with mj_saveLastXML, which lists every point, and import that"
# Attributes of a flexcomp that say where its points are; those that are there change them.
_MOVED = ("quat", "axisangle", "xyaxes", "zaxis", "euler", "scale", "origin", "rigid")
_LOOKS = (
    "name", "type", "dim", "point", "element", "file", "mass", "pos", "radius", "rgba", "material",
    "group", "flatskin", "inertiabox", "texcoord", "dof", "count", "spacing",
)  # fmt: skip


def read_mujoco(path: Path) -> Model:
    """Read the one flex of an MJCF file, as flexcomp or written out.

    Raises:
        ImportRefusedError: What a case cannot say, with its line.
        FileFormatError: A file that cannot be opened.
    """
    root = read_xml(path)
    if root.tag != "mujoco":
        raise root.refuse(f"<{root.tag}> is no MuJoCo model; that begins with <mujoco>")
    ignored: list[str] = []
    gravity = (0.0, 0.0, -9.81)
    in_world: list[Element] = []
    flexes: list[Element] = []
    for section in root:
        if section.tag in _FORCEFUL:
            if section.children or section.tag == "include":
                raise section.refuse(f"<{section.tag}>: it acts on the body in ways no case knows")
        elif section.tag == "worldbody":
            in_world += section
        elif section.tag == "deformable":
            flexes += section
        elif section.tag == "option":
            gravity = _gravity(section, gravity)
            ignored.append(f"line {section.line} <option>: how MuJoCo steps in time")
        elif section.tag in _HARMLESS:
            ignored.append(f"line {section.line} <{section.tag}>")
        else:
            raise section.refuse(f"<{section.tag}> is not known here")
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
        [Body(_constants(flex, ignored), mass / volume, flex.source)],
        np.zeros(len(cells), dtype=np.int64),
        np.arange(len(points)),
        acceleration=gravity if any(gravity) else None,
        notes=["MuJoCo solves motion: the case asks for the state of rest under its loads"],
        ignored=ignored,
    )
    if is_pinned.any():
        still = dict.fromkeys(range(3), 0.0)
        model.supports.append(FixedNodes("pinned", np.flatnonzero(is_pinned), still, flex.source))
    if model.acceleration is not None:
        model.notes.append(
            "a flex spreads its mass evenly over its points, the case by volume over its cells: "
            "the weight is the same in all, not at each point"
        )
    return model


def _only_flex(
    root: Element, in_world: list[Element], flexes: list[Element]
) -> tuple[Element, list[Element]]:
    """The one solid flex, and the bodies of the world; nothing else may touch it."""
    for child in in_world:
        if child.tag not in ("flexcomp", "body", "light", "camera", "site"):
            raise child.refuse(f"<{child.tag}> beside the flex: it may touch it; take it out")
    found = [*(child for child in in_world if child.tag == "flexcomp"), *flexes]
    bodies = [child for child in in_world if child.tag == "body"]
    if len(found) != 1:
        raise (found[1] if found else root).refuse(
            f"{len(found)} flexes; a case has one body of tetrahedra"
        )
    if found[0].attributes.get("dim", "2") != "3":
        raise found[0].refuse("a flex that is no solid; a case has one of dim 3")
    if bodies and not flexes:
        raise bodies[0].refuse("<body> beside the flexcomp: it may touch or fix it; take it out")
    return found[0], bodies


def _constants(flex: Element, ignored: list[str]) -> dict[str, float | str]:
    for child in flex:
        if child.tag == "contact":
            # Alone in the world it can only touch itself, which no case knows.
            ignored.append(f"line {child.line} <contact>: of the body with itself")
        elif child.tag == "edge":
            stiff = _number(child, "stiffness", 0.0)
            if stiff or child.attributes.get("equality", "false") != "false":
                raise child.refuse("<edge>: springs or constraints along edges; a case has none")
        elif child.tag == "plugin":
            raise child.refuse("<plugin>: forces that only it knows; use <elasticity>")
        elif child.tag not in ("elasticity", "pin"):
            raise child.refuse(f"<{child.tag}> in <{flex.tag}> is not known here")
    elasticity = flex.child("elasticity")
    if elasticity is None or _number(elasticity, "young", 0.0) <= 0.0:
        raise (elasticity or flex).refuse("<elasticity young=...> above 0 is needed")
    elasticity.only_attributes("young", "poisson", "damping", "thickness", "elastic2d")
    return {
        "law": str(Law.SAINT_VENANT_KIRCHHOFF),
        "youngs_modulus": _number(elasticity, "young", 0.0),
        "poissons_ratio": _number(elasticity, "poisson", 0.0),
    }


def _flexcomp(
    flex: Element, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    for name in _MOVED:
        if name in flex.attributes:
            raise flex.refuse(f"<flexcomp {name}=...>: {_OPEN}")
    flex.only_attributes(*_LOOKS)
    if flex.attributes.get("dof", "full") != "full":
        raise flex.refuse("<flexcomp dof=...>: not every point moves by itself")
    kind = flex.attributes.get("type", "grid")
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
    points = points + np.array(flex.vector(flex.attributes.get("pos", "0 0 0")))
    is_pinned = np.zeros(len(points), dtype=bool)
    for pin in (child for child in flex if child.tag == "pin"):
        pin.only_attributes("id", "range")
        numbers = pin.wholes(pin.attributes.get("id", ""))
        ends = pin.wholes(pin.attributes.get("range", ""))
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


def _gravity(option: Element, known: tuple[float, float, float]) -> tuple[float, float, float]:
    for flag in option:
        if flag.tag == "flag" and flag.attributes.get("gravity", "enable") == "disable":
            return (0.0, 0.0, 0.0)
        if flag.tag == "flag" and flag.attributes.get("passive", "enable") == "disable":
            raise flag.refuse("passive forces are off: the body has no stiffness")
    given = option.attributes.get("gravity")
    return known if given is None else option.vector(given)


def _number(element: Element, name: str, default: float) -> float:
    found = element.numbers(element.attributes.get(name, repr(default)))
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
    if "node" in flex.attributes:
        raise flex.refuse("<flex node=...>: points that move by those of a coarser grid")
    positions: dict[str, tuple[float, float, float]] = {}
    masses: dict[str, float] = {}
    for body in bodies:
        body.only_attributes("name", "pos")
        name = body.require("name")
        positions[name] = body.vector(body.attributes.get("pos", "0 0 0"))
        masses[name] = _mass_of_slider(body)
    names = flex.require("body").split()
    vertices = np.array(flex.numbers(flex.attributes.get("vertex", "")), dtype=np.float64)
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
    body.only("inertial", "joint")
    axes = set()
    for joint in body:
        if joint.tag != "joint":
            continue
        joint.only_attributes("name", "type", "axis", "damping", "pos")
        if joint.attributes.get("type") != "slide":
            raise joint.refuse("a joint that is no slide")
        axes.add(joint.vector(joint.attributes.get("axis", "0 0 1")))
    if axes != _AXES:
        raise body.refuse("a point of a flex slides along x, y and z")
    inertial = body.child("inertial")
    if inertial is None:
        raise body.refuse("<body> needs <inertial mass=...>")
    (mass,) = inertial.numbers(inertial.require("mass"))[:1] or (0.0,)
    return mass
