"""A first case of a body: what may be held and pushed, guessed from its extents."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Points
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.files import MESH_SUFFIXES, read_mesh
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_box
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case.annotated import annotated_case
from palpate.validation.case.geometry import load_surface
from palpate.validation.case.units import FORCE, LENGTH, STRESS

_YOUNGS_MODULUS, _STRESS = 10.0, "kPa"
# The guessed pull stretches a bar of the body's length and volume by so much [-].
_STRETCH = 0.05
# Parts of the length that are tried, until each end has a facet in it.
_ENDS = (0.1, 0.2, 0.3, 0.45)
_AXES = "xyz"
_BOX, _BOX_EDGE = (60.0, 20.0, 20.0), 4.0  # mm

_HEAD = """\
# A case of palpate. Every key is here with what it means: what begins with # and no space is not
# set, and shows its default or an example. Lengths and stresses are in the units of [units].
# Look first at what is marked GUESS. Then:
#   palpate check {name} --picture case.png     is it what was meant?
#   palpate report {name} -o out                solve, judge, and see
"""


def first_case(body: Path | None, *, target: Path, unit: str = "mm", repair: bool = False) -> str:
    """A case file, as text, for a surface or mesh file; for a box where there is none.

    Args:
        body: Beside the case file to be, or below it.
        target: The case file to be.
        unit: Of the file: m, cm or mm.
        repair: Mend the surface where that is safe, here and in the case.

    Raises:
        InputError: A body that cannot be read, bounds no solid, or lies elsewhere.
    """
    if unit not in LENGTH:
        raise InputError(f"unit {unit!r}: use one of {', '.join(LENGTH)}")
    geometry, surface = _geometry(body, target, LENGTH[unit], repair)
    title = f"{Path(body).stem if body else 'A box'}, held at one end, pulled at the other"
    values: dict[str, Any] = {
        "schema": 1,
        "title": title,
        "strain": "green",
        "units": {"length": unit, "force": "N", "stress": _STRESS, "density": "kg/m3"},
        "geometry": geometry,
        "material": {"youngs_modulus": _YOUNGS_MODULUS, "poissons_ratio": 0.4, "density": 1000.0},
    }
    held_and_pulled, remarks = _ends(surface, unit)
    remarks["material"] = "GUESS: soft tissue of no particular organ."
    return _HEAD.format(name=target.name) + annotated_case(
        {**values, **held_and_pulled, "check": FIRST_CHECKS}, {**remarks, **_REMARKS}
    )


FIRST_CHECKS = [
    {
        "metric": "displacement_l2",
        "against": "same_mesh",
        "limit": 1e-8,
        "reason": "same equations on the same mesh: only solver error is left",
    },
    {
        "metric": "displacement_l2",
        "against": "truth",
        "limit": 0.1,
        "reason": "GUESS: say what accuracy its user needs, and why",
    },
    {
        "metric": "smallest_det_f",
        "against": "candidate",
        "limit": 0.0,
        "reason": "no cell may be inverted",
    },
]
_REMARKS = {"check 2": "GUESS: the limit. It should come from what the answer is used for."}


def _geometry(
    body: Path | None, target: Path, scale: float, repair: bool
) -> tuple[dict[str, Any], TriSurface]:
    """The table of a body, and its boundary [m]."""
    if body is None:
        millimetre = 1e-3 / scale
        size = [side * millimetre for side in _BOX]
        x, y, z = (side * scale for side in size)
        surface = shape_box((x, y, z), edge_length=_BOX_EDGE * millimetre * scale)
        return {"shape": "box", "size": size, "edge_length": _BOX_EDGE * millimetre}, surface
    name = _beside(body, target)
    choices = RepairChoices() if repair else None
    if body.suffix.lower() in MESH_SUFFIXES:
        try:
            return {"mesh": name}, read_mesh(body, scale=scale).surface()
        except FileFormatError as error:
            if not body.is_file():
                raise
            trouble = error
        try:
            surface = load_surface(body, scale=scale, repair=choices).surface
        except FileFormatError:
            raise trouble from None
    else:
        surface = load_surface(body, scale=scale, repair=choices).surface
    return {"surface": name, **({"repair": True} if repair else {})}, surface


def _beside(body: Path, target: Path) -> str:
    folder, real = Path(os.path.realpath(target.parent)), Path(os.path.realpath(body))
    if not real.is_relative_to(folder):
        raise InputError(
            f"{body} must lie beside the case file or below it: write the case to "
            f"{body.parent / target.name}, or copy the file to {target.parent}"
        )
    return real.relative_to(folder).as_posix()


def _ends(surface: TriSurface, unit: str) -> tuple[dict[str, Any], dict[str, str]]:
    """A support and a load at the ends of the longest side, with what to say of them."""
    used = surface.points[np.unique(surface.facets)]
    low, high = used.min(axis=0), used.max(axis=0)
    axis = int(np.argmax(high - low))
    length = float(high[axis] - low[axis])
    centroids = surface.points[surface.facets].mean(axis=1)[:, axis]
    part = next(
        (p for p in _ENDS if _has_both(centroids, low[axis] + p * length, high[axis] - p * length)),
        _ENDS[-1],
    )
    force = _STRETCH * _YOUNGS_MODULUS * STRESS[_STRESS] * abs(surface.volume) / length
    along = [0.0, 0.0, 0.0]
    along[axis] = _rounded(force / FORCE["N"])
    values = {
        "support": [{"region": _half_space(low + part * (high - low), axis, -1.0, unit)}],
        "load": [
            {
                "kind": "force",
                "force": along,
                "region": _half_space(high - part * (high - low), axis, 1.0, unit),
            }
        ],
    }
    extent = f"{_shown(low[axis], unit):g} to {_shown(high[axis], unit):g} {unit}"
    where = f"the body reaches from {extent} along {_AXES[axis]}, its longest side;"
    return values, {
        "support": f"GUESS: {where}\nits first {100 * part:.0f} % are held.",
        "load": f"GUESS: {where}\nits last {100 * part:.0f} % are pulled outwards, so that it "
        f"becomes about {100 * _STRETCH:.0f} % longer.",
    }


def _has_both(places: Points, first: float, last: float) -> bool:
    return bool((places <= first).any() and (places >= last).any())


def _half_space(point: Points, axis: int, sign: float, unit: str) -> dict[str, Any]:
    at, normal = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    at[axis], normal[axis] = _shown(float(point[axis]), unit), sign
    return {"half_space": {"point": at, "normal": normal}}


def _shown(metres: float, unit: str) -> float:
    return _rounded(metres / LENGTH[unit], 6)


def _rounded(value: float, digits: int = 3) -> float:
    return float(f"{value:.{digits}g}")
