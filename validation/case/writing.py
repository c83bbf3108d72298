"""Case files written: every key with its meaning, and a first case of a body."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from palpate.meshes.arrays import Points
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.files import MESH_SUFFIXES, read_mesh
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.shapes import shape_box
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case.geometry import load_surface
from palpate.validation.case.loading_schema import PointForceSpec
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.schema_keys import choices_of, keys_of, plain_kind, tables_of
from palpate.validation.case.units import FORCE, LENGTH, STRESS
from palpate.validation.metrics import CATALOGUE

# Shown where a key has no default; words by name, all else by type.
_EXAMPLES: dict[str, Any] = {
    "surface": "probe.stl",
    "mesh": "liver.vtu",
    "group": "attachment",
    "fitted": ["material.youngs_modulus"],
    "name": "tip",
    "files": ["run_a.csv", "run_b.csv"],
    "markers": ["tip"],
    "frame": ["tip", "left", "right"],
    "set": {"mass[0].mass": 0.0},
    "inputs": ["material.youngs_modulus"],
    "standard": [1000.0],
    "correlation": [[1.0]],
    "published": {"source": "who, when, which table"},
    "region": {"half_space": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
    "times": [0.0, 0.1],
    "factors": [0.0, 1.0],
    "normal": [0.0, 0.0, 1.0],
    "axis": [0.0, 0.0, 1.0],
    "direction": [0.0, 0.0, -1.0],
    "acceleration": [0.0, 0.0, -9.81],
    "poissons_ratio": 0.4,
    "angle_deg": 90.0,
    "time": 0.0,
    "end_time": 0.5,
    "time_step": 1e-4,
}
_POINT = {"nearest": [1.0, 1.0, 1.0]}


def annotated_case(values: Mapping[str, Any], remarks: Mapping[str, str]) -> str:
    """A case file in TOML: the given values, and every other key as a comment.

    Remarks are lines above a table, by its name (`support`) or its name and number (`check 2`).
    """
    writer = _Writer(remarks)
    return "\n".join([*writer.table(CaseSpec, values, "", is_given=True), ""])


class _Writer:
    """One table after another; a kind of table that was shown is not shown in full again."""

    def __init__(self, remarks: Mapping[str, str]) -> None:
        self.remarks = remarks
        self.shown: set[type[BaseModel]] = set()

    def table(
        self, model: type[BaseModel], values: Mapping[str, Any], name: str, *, is_given: bool
    ) -> Iterator[str]:
        """The keys of a table, plain ones first: TOML gives what follows to its last header."""
        is_first = model not in self.shown
        self.shown.add(model)
        later = []
        for key, field in keys_of(model):
            if not is_first and key not in values:
                continue
            kinds = tables_of(field)
            if kinds and (set(kinds) - self.shown or (not name and key in values)):
                later.append((key, field, kinds))
                continue
            value = values[key] if key in values else _example(key, field)
            if model is PointForceSpec and key == "region":
                value = values.get(key, _POINT)
            yield from _lines(key, value, field if is_first else None, is_given and key in values)
        for key, field, kinds in later:
            yield from self._below(key, field, kinds, values, name, is_given=is_given)

    def _below(
        self,
        key: str,
        field: FieldInfo,
        kinds: list[type[BaseModel]],
        values: Mapping[str, Any],
        name: str,
        *,
        is_given: bool,
    ) -> Iterator[str]:
        """The table of a key, or each of its tables, and one of every kind that is not there."""
        path = f"{name}.{key}" if name else key
        is_list = get_origin(plain_kind(field.annotation)) is tuple
        header = f"[[{path}]]" if is_list else f"[{path}]"
        found = values.get(key, [] if is_list else None)
        given = list(found) if is_list else [found] if found is not None else []
        wanted = [(_kind_of(one, kinds), one, is_given) for one in given]
        there = {kind for kind, _, _ in wanted}
        wanted += [(kind, {}, False) for kind in kinds if kind not in there | self.shown]
        for number, (kind, one, is_there) in enumerate(wanted, 1):
            mark = "" if is_there else "#"
            if not name:
                yield ""
            for remark in (path, f"{path} {number}"):
                if number == 1 or remark != path:
                    yield from (f"# {text}" for text in self.remarks.get(remark, "").splitlines())
            yield f"{mark}{header}" + (f"  # {field.description}" if number == 1 else "")
            yield from self.table(kind, one, path, is_given=is_there)


def _kind_of(value: Mapping[str, Any], kinds: list[type[BaseModel]]) -> type[BaseModel]:
    for kind in kinds:
        if "kind" in kind.model_fields and choices_of(kind.model_fields["kind"]) == [value["kind"]]:
            return kind
    return kinds[0]


def _example(key: str, field: FieldInfo) -> Any:
    """The default, or what could stand there."""
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_defaults=False, by_alias=True)
    if not field.is_required() and value is not None and value not in ((), {}):
        return value
    if key in _EXAMPLES:
        return _EXAMPLES[key]
    choices = choices_of(field)
    if choices:
        return choices[0]
    kinds = tables_of(field)
    if kinds:
        one = {k: _example(k, f) for k, f in keys_of(kinds[0]) if f.is_required()}
        return [one] if get_origin(plain_kind(field.annotation)) is tuple else one
    kind = plain_kind(field.annotation)
    if get_origin(kind) is tuple:
        count = len([a for a in get_args(kind) if a is not ...])
        return [_of_type(plain_kind(get_args(kind)[0]))] * count
    return _of_type(kind)


def _of_type(kind: Any) -> Any:
    return {float: 1.0, int: 1, bool: False}.get(kind, "")


def _lines(key: str, value: Any, field: FieldInfo | None, is_given: bool) -> Iterator[str]:
    """A key with what the schema says of it, and the words that may stand there."""
    text = f"{'' if is_given else '#'}{key} = {toml_value(value)}"
    if field is None:
        yield text
        return
    words = [str(choice) for choice in choices_of(field)]
    about = str(field.description)
    if words == list(CATALOGUE):
        yield from (f"#   {metric.name}: {metric.meaning}" for metric in CATALOGUE.values())
    elif len(words) > 1:
        about += f" One of {', '.join(words)}."
    yield f"{text:<34}  # {about}"


def toml_value(value: Any) -> str:
    """A value as TOML, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(str(value), ensure_ascii=False)
    return repr(value)


def _key(name: str) -> str:
    """A key of a table, quoted where it is no plain word: `"mass[0].mass"`."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def case_text(values: Mapping[str, Any]) -> str:
    """A case file without remarks: tables one below another, each key on a line."""
    lines = [f"{k} = {toml_value(v)}" for k, v in values.items() if not isinstance(v, dict | list)]
    for key, value in values.items():
        tables = value if isinstance(value, list) else [value] if isinstance(value, dict) else []
        header = f"[[{key}]]" if isinstance(value, list) else f"[{key}]"
        for table in tables:
            lines += ["", header, *(f"{_key(k)} = {toml_value(v)}" for k, v in table.items())]
    return "\n".join([*lines, ""])


_YOUNGS_MODULUS, _STRESS = 10.0, "kPa"
# The guessed pull moves no point farther than so much of the body's length [-].
STRETCH = 0.05
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


def first_case(
    body: Path | None,
    *,
    target: Path,
    unit: str | None = None,
    repair: bool = False,
    factor: float | None = None,
) -> str:
    """A case file, as text, for a surface or mesh file beside it or below; for a box without one.

    Args:
        body: The file; None is a box.
        target: Where the case will be written.
        unit: Unit of length of the file; None guesses mm.
        repair: The surface is repaired where that is safe, here and in the case.
        factor: By how much to multiply the force that stretches a bar of the body's length and
            volume by `STRETCH`, so that the body is moved by that much; None where nobody knows.

    Raises:
        InputError: A body that cannot be read, bounds no solid, or lies elsewhere.
    """
    is_unit_given, unit = unit is not None or body is None, unit or "mm"
    if unit not in LENGTH:
        raise InputError(f"unit {unit!r}: use one of {', '.join(LENGTH)}")
    geometry, surface = _geometry(body, target, LENGTH[unit], repair)
    title = f"{Path(body).stem if body else 'A box'}, fixed at one end, pulled at the other"
    values: dict[str, Any] = {
        "schema": 1,
        "title": title,
        "strain": "green",
        "units": {"length": unit, "force": "N", "stress": _STRESS, "density": "kg/m3"},
        "geometry": geometry,
        "material": {"youngs_modulus": _YOUNGS_MODULUS, "poissons_ratio": 0.4, "density": 1000.0},
    }
    fixed_and_pulled, remarks = _ends(surface, unit, factor)
    remarks["material"] = "GUESS: soft tissue of no particular organ."
    if not is_unit_given:
        remarks["units"] = f"GUESS: the file says no unit of length; it is taken for {unit}."
    return _HEAD.format(name=target.name) + annotated_case(
        {**values, **fixed_and_pulled, "check": FIRST_CHECKS}, {**remarks, **_REMARKS}
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
_REMARKS = {"check 2": "GUESS: the limit. It should come from what the result is used for."}


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
            f"{body} must lie beside the case file or below it: say --copy, or write the case to "
            f"{body.parent / target.name}"
        )
    return real.relative_to(folder).as_posix()


def _ends(
    surface: TriSurface, unit: str, factor: float | None
) -> tuple[dict[str, Any], dict[str, str]]:
    """A support and a load at the ends of the longest side, with what to say of them."""
    used = surface.points[np.unique(surface.facets)]
    low, high = used.min(axis=0), used.max(axis=0)
    axis = int(np.argmax(high - low))
    length = float(high[axis] - low[axis])
    centroids = surface.points[surface.facets].mean(axis=1)[:, axis]
    part = next(
        (
            p
            for p in _ENDS
            if (centroids <= low[axis] + p * length).any()
            and (centroids >= high[axis] - p * length).any()
        ),
        _ENDS[-1],
    )
    force = STRETCH * _YOUNGS_MODULUS * STRESS[_STRESS] * abs(surface.volume) / length
    force *= 1.0 if factor is None else factor
    size = f"{100 * STRETCH:.0f} %"
    effect = (
        f"so that\nno point moves farther than {size} of that length (solved by linear strain)."
    )
    if factor is None:
        effect = f"by\nwhat makes a straight bar of its volume {size} longer; it was not solved."
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
        "support": f"GUESS: {where}\nits first {100 * part:.0f} % are fixed.",
        "load": f"GUESS: {where}\nits last {100 * part:.0f} % are pulled outwards, {effect}",
    }


def _half_space(point: Points, axis: int, sign: float, unit: str) -> dict[str, Any]:
    at, normal = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    at[axis], normal[axis] = _shown(float(point[axis]), unit), sign
    return {"half_space": {"point": at, "normal": normal}}


def _shown(metres: float, unit: str) -> float:
    return _rounded(metres / LENGTH[unit], 6)


def _rounded(value: float, digits: int = 3) -> float:
    return float(f"{value:.{digits}g}")
