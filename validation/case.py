"""A case: a TOML file that says what body is held and pushed how, and what is checked."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from palpate.meshes.boundary_conditions import (
    BodyForce,
    Load,
    PointForce,
    Pressure,
    Support,
    Traction,
)
from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.rigid_modes import require_supported
from palpate.validation.case_schema import (
    CaseSpec,
    CheckSpec,
    ForceSpec,
    GravitySpec,
    PointForceSpec,
    PressureSpec,
    TractionSpec,
)
from palpate.validation.filling import BuiltMesh
from palpate.validation.geometry import build_mesh
from palpate.validation.regions import nearest_point, select_facets

_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


class CaseError(InputError):
    """A case file that cannot be used; the message names file, line, key and remedy."""


def builtin_folder() -> Path:
    """Where the built-in cases and their meshes are."""
    return Path(str(resources.files("palpate.validation"))) / "cases"


def builtin_cases() -> list[str]:
    """Names of the built-in cases, sorted."""
    return sorted(path.stem for path in builtin_folder().glob("*.toml"))


def load_case(name_or_path: str | Path) -> Case:
    """Read a case: a built-in name, or a path to a .toml file.

    Raises:
        CaseError: No such case, not TOML, an unknown or missing key, a bad value.
    """
    text = str(name_or_path)
    path = Path(text)
    if path.suffix != ".toml":
        if text not in builtin_cases():
            near = difflib.get_close_matches(text, builtin_cases(), n=1)
            hint = f"did you mean {near[0]!r}?" if near else "see `palpate cases`"
            raise CaseError(f"no built-in case {text!r}; {hint} A file needs the ending .toml")
        path = builtin_folder() / f"{text}.toml"
    if not path.is_file():
        raise CaseError(f"{path}: no such file")
    if not _NAME.fullmatch(path.stem):
        raise CaseError(
            f"{path.name!r}: a case's name may hold letters, digits, '.', '_' and '-' (64 at most)"
        )
    try:
        source = path.read_text(encoding="utf-8-sig")
        data = tomllib.loads(source)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise CaseError(f"{path}: not TOML: {error}") from error
    try:
        spec = CaseSpec.model_validate(data)
    except ValidationError as error:
        raise CaseError(_explain(path, source, data, error)) from error
    return Case(path, spec)


@dataclass(frozen=True, eq=False)
class Case:
    """A case file that was read; mesh and problem are built when first asked for."""

    path: Path
    spec: CaseSpec

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    @property
    def folder(self) -> Path:
        """Where the file lies; its paths may not leave it."""
        return self.path.parent

    @property
    def is_builtin(self) -> bool:
        """Whether it came with palpate."""
        return self.folder == builtin_folder()

    @property
    def title(self) -> str:
        """One line for people."""
        return self.spec.title

    @property
    def strain(self) -> Strain:
        """The strain measure the case is about."""
        return self.spec.strain

    @property
    def checks(self) -> Sequence[CheckSpec]:
        """What is judged."""
        return self.spec.check

    @cached_property
    def mesh(self) -> BuiltMesh:
        """The mesh, and a line on who made it."""
        return build_mesh(self.spec, self.folder)

    @cached_property
    def problem(self) -> Problem:
        """Mesh, material, supports and loads in SI units.

        Raises:
            InputError: A region that selects nothing, a body that floats, a bad value.
        """
        units, mesh = self.spec.units, self.mesh.mesh
        try:
            material = Material(
                units.pascals(self.spec.material.youngs_modulus),
                self.spec.material.poissons_ratio,
                units.kilograms_per_cubic_metre(self.spec.material.density),
            )
            supports = tuple(self._support(index) for index in range(len(self.spec.support)))
            loads = tuple(self._load(index, material) for index in range(len(self.spec.load)))
            problem = Problem(mesh, material, supports, loads)
            require_supported(problem)
        except InputError as error:
            error.args = (f"{self.path.name}: {error}",)
            raise
        return problem

    def _support(self, index: int) -> Support:
        spec, mesh, units = self.spec.support[index], self.mesh.mesh, self.spec.units
        what = f"support {index + 1}"
        components = tuple(axis in spec.components for axis in "xyz")
        moved = [units.metres(x) for x in spec.displacement]
        held = (components[0], components[1], components[2])
        displacement = (moved[0], moved[1], moved[2])
        if spec.region.nearest is not None:
            point = nearest_point(mesh, spec.region, units, what)
            return Support(point, components=held, displacement=displacement)
        facets = select_facets(mesh, spec.region, units, what)
        points = np.unique(facets).astype(np.int32)
        return Support(points, facets, held, displacement)

    def _load(self, index: int, material: Material) -> Load:
        spec, mesh, units = self.spec.load[index], self.mesh.mesh, self.spec.units
        what = f"load {index + 1}"
        match spec:
            case GravitySpec():
                g = [material.density * a for a in spec.acceleration]
                return BodyForce((g[0], g[1], g[2]))
            case PointForceSpec():
                point = nearest_point(mesh, spec.region, units, what)
                return PointForce(point, np.array([[units.newtons(f) for f in spec.force]]))
            case PressureSpec():
                facets = select_facets(mesh, spec.region, units, what)
                return Pressure(facets, units.pascals(spec.pressure))
            case TractionSpec():
                facets = select_facets(mesh, spec.region, units, what)
                t = [units.pascals(x) for x in spec.traction]
                return Traction(facets, (t[0], t[1], t[2]))
            case ForceSpec():
                facets = select_facets(mesh, spec.region, units, what)
                corners = mesh.points[facets]
                normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                area = float(0.5 * np.linalg.norm(normals, axis=1).sum())
                t = [units.newtons(f) / area for f in spec.force]
                return Traction(facets, (t[0], t[1], t[2]))


def inside_folder(folder: Path, name: str) -> Path:
    """A path of a case, which may not leave the case's folder.

    Raises:
        CaseError: It does, links included.
    """
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise CaseError(f"{name!r} lies outside the case's folder; put the file beside the case")
    if not path.is_file():
        raise FileFormatError(name, f"no such file beside the case in {folder}")
    return path


def _explain(path: Path, source: str, data: dict[str, Any], error: ValidationError) -> str:
    """At most two lines: file, line, key, value, remedy."""
    lines = []
    for found in error.errors()[:2]:
        place = [part for part in found["loc"] if not _is_tag(part, found["loc"])]
        key = ".".join(str(part + 1) if isinstance(part, int) else part for part in place)
        where = f"{path}:{_line_of(source, place)}"
        match found["type"]:
            case "extra_forbidden":
                near = difflib.get_close_matches(str(place[-1]), _siblings(place), n=1)
                hint = f"did you mean {near[0]!r}?" if near else "remove it"
                lines.append(f"{where}: unknown key {key!r}; {hint}")
            case "missing":
                lines.append(f"{where}: missing key {key!r}; add it")
            case _:
                shown = found.get("input")
                value = f" = {shown!r}" if isinstance(shown, str | int | float) else ""
                message = found["msg"].removeprefix("Value error, ")
                lines.append(f"{where}: {key or 'case'}{value}: {message}")
    if not data:
        lines = [f"{path}: the file is empty; see a built-in case for what goes in"]
    return "\n".join(lines)


_TAGS = {"force", "traction", "pressure", "gravity", "point_force"}


def _is_tag(part: int | str, loc: tuple[int | str, ...]) -> bool:
    """Pydantic puts the kind of a load into the place: load.0.force.region."""
    return part in _TAGS and len(loc) > 2 and loc[0] == "load" and loc.index(part) == 2


def _siblings(place: list[int | str]) -> list[str]:
    """Keys that may stand where an unknown one was found."""
    model: Any = CaseSpec
    for part in place[:-1]:
        if isinstance(part, int) or not (isinstance(model, type) and issubclass(model, BaseModel)):
            continue
        annotation = str(model.model_fields[part].annotation) if part in model.model_fields else ""
        models = {cls.__name__: cls for cls in _all_models()}
        named = [cls for name, cls in models.items() if re.search(rf"\b{name}\b", annotation)]
        if len(named) != 1:
            return sorted({key for cls in (named or models.values()) for key in cls.model_fields})
        model = named[0]
    return [f.alias or name for name, f in model.model_fields.items()]


def _all_models() -> list[type[BaseModel]]:
    import palpate.validation.case_schema as schema

    return [
        value
        for value in vars(schema).values()
        if isinstance(value, type) and issubclass(value, BaseModel) and value is not BaseModel
    ]


def _line_of(source: str, place: list[int | str]) -> int:
    """The line where the deepest part of a place stands; 1 when it cannot be found."""
    lines = source.splitlines()
    start = 0
    best = 1
    for depth, part in enumerate(place):
        if isinstance(part, int):
            continue
        nth = place[depth + 1] if depth + 1 < len(place) else 0
        wanted = nth if isinstance(nth, int) else 0
        pattern = re.compile(
            rf"^\s*(\[+\s*([\w-]+\.)*{re.escape(part)}\s*\]+|{re.escape(part)}\s*=)"
            rf"|[{{,]\s*{re.escape(part)}\s*="
        )
        hits = [k for k in range(start, len(lines)) if pattern.search(lines[k])]
        if len(hits) <= wanted:
            break
        start = hits[wanted]
        best = start + 1
    return best
