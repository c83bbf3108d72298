"""A case: a TOML file that says what body is supported and loaded how, and what is checked."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Problem, Strain, with_law
from palpate.meshes.rigid_tool import ContactRule
from palpate.meshes.untrusted import UntrustedTextError, parse_toml, read_text
from palpate.validation.case.regions import part_of_check, point_at
from palpate.validation.case.schema import CaseSpec, CheckSpec
from palpate.validation.case.schema_keys import choices_of, keys_of, tables_of

if TYPE_CHECKING:
    from palpate.validation.case.meshing import BuiltMesh


class CaseError(InputError):
    """A case file that cannot be used; the message names file, line, key and remedy."""


def explain(path: Path, source: str, data: dict[str, Any], error: ValidationError) -> str:
    """At most two lines: file, line, key, value, remedy."""
    if not data:
        return f"{path}: the file is empty; see a built-in case for what goes in"
    return "\n".join(_line(path, source, found) for found in error.errors()[:2])


def _line(path: Path, source: str, found: ErrorDetails) -> str:
    """One mistake."""
    loc = found["loc"]
    location = [part for index, part in enumerate(loc) if not _is_tag(index, loc)]
    context = found.get("ctx", {})
    location += context.get("path", ())
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in location)
    # What is missing stands nowhere: the table where it should.
    stands = location[:-1] if found["type"] == "missing" else location
    where = f"{path}:{_line_of(source, stands)}"
    match found["type"]:
        case "extra_forbidden":
            hint = _suggestion(str(location[-1]), _siblings(loc)) or "remove it"
            return f"{where}: unknown key {key!r}; {hint}"
        case "missing":
            return f"{where}: missing key {key!r}; add it"
        case "union_tag_invalid":
            shown, message = repr(context["tag"]), _choice(context["tag"], list(_LOADS))
            return f"{where}: {key}.kind = {shown}: {message}"
        case "union_tag_not_found":
            return f"{where}: missing key '{key}.kind'; add it: {', '.join(_LOADS)}"
        case "literal_error" | "enum":
            known = re.findall(r"'([^']*)'", str(context.get("expected", "")))
            message = _choice(found["input"], known)
        case "tuple_type":
            message = "must be a list in brackets"
            if location[-1] == "size":
                message += "; cells are sized by edge_length"
        case "published":
            return f"{where}: {key!r} {found['msg']}"
        case _:
            message = found["msg"].removeprefix("Value error, ")
    return f"{where}: {key or 'case'}{_value(found.get('input'))}: {message}"


def _value(value: Any) -> str:
    """The value as in the file, where it is short enough to be shown."""
    if isinstance(value, bool):
        return f" = {str(value).lower()}"
    if isinstance(value, str | int | float):
        text = repr(value)
        return f" = {text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + '...'}"
    return ""


def _choice(value: Any, known: list[str]) -> str:
    """A word that is not among those that may stand there."""
    return _suggestion(str(value), known) or f"use {', '.join(known)}"


def _suggestion(word: str, known: list[str]) -> str:
    """The word that was meant, as a question; empty where no known word is near."""
    near = difflib.get_close_matches(word, known, n=1)
    near = near or difflib.get_close_matches(word.lower(), known, n=1)
    near = near or [key for key, others in _ALSO_CALLED.items() if word.lower() in others]
    return f"did you mean {near[0]!r}?" if near and near[0] in known else ""


_MOST_SHOWN = 60
# What others call one of our keys, where its spelling gives no hint.
_ALSO_CALLED = {
    "edge_length": (
        "size", "h", "mesh_size", "element_size", "cell_size", "max_size", "resolution", "hmax",
    ),
    "youngs_modulus": ("e", "young", "youngs", "modulus", "stiffness"),
    "poissons_ratio": ("nu", "v", "poisson"),
    "density": ("rho",),
    "acceleration": ("g", "gravity"),
    "end_time": ("duration", "t_end", "stop", "t"),
    "time_step": ("dt", "step"),
    "limit": ("tol", "tolerance", "max", "threshold", "epsilon"),
    "reason": ("why", "source", "comment"),
    "length": ("mm", "unit"),
}  # fmt: skip
_LOADS: dict[str, type[BaseModel]] = {
    choices_of(model.model_fields["kind"])[0]: model
    for model in tables_of(CaseSpec.model_fields["load"])
}


def _is_tag(index: int, loc: tuple[int | str, ...]) -> bool:
    """Pydantic adds the kind of a load to the path of an error: load.0.force.region."""
    return index == 2 and loc[0] == "load" and loc[index] in _LOADS


def _siblings(loc: tuple[int | str, ...]) -> list[str]:
    """Keys that may stand where an unknown one was found."""
    model: type[BaseModel] = CaseSpec
    for index, part in enumerate(loc[:-1]):
        if isinstance(part, int):
            continue
        if _is_tag(index, loc):
            model = _LOADS[str(part)]
            continue
        field = dict(keys_of(model)).get(part)
        kinds = tables_of(field) if field is not None else []
        if len(kinds) == 1:
            model = kinds[0]
        elif part != "load":
            return []
    return [name for name, _ in keys_of(model)]


def _line_of(source: str, location: list[int | str]) -> int:
    """The line of the deepest part of a path that is found; 1 where none is."""
    lines = source.splitlines()
    start = 0
    best = 1
    for depth, part in enumerate(location):
        if isinstance(part, int):
            continue
        nth = location[depth + 1] if depth + 1 < len(location) else 0
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


# Small cases, statics and motion, judged against stored references in seconds.
QUICK = ("block", "block-motion", "column", "drag")

_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


def builtin_folder() -> Path:
    """The folder of the built-in cases and their meshes."""
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
    require_case_name(path)
    try:
        source = read_text(path)
        data = parse_toml(source)
    except FileFormatError as error:
        raise CaseError(str(error)) from error
    except UntrustedTextError as error:
        raise CaseError(f"{path}: {error}") from error
    try:
        spec = CaseSpec.model_validate(data)
    except ValidationError as error:
        raise CaseError(explain(path, source, data, error)) from error
    return Case(path, spec, source)


def require_case_name(path: Path) -> None:
    """Refuse a file whose name cannot be a case's.

    Raises:
        CaseError: It has other letters, or is too long.
    """
    if not _NAME.fullmatch(path.stem):
        raise CaseError(
            f"{path.name!r}: a case's name may hold letters, digits, '.', '_' and '-' (64 at most)"
        )


def load_cases(names: Sequence[str]) -> list[Case]:
    """Read several cases; their names distinguish their results.

    Raises:
        CaseError: See `load_case`, of each that cannot be read; or two cases of one name, small or
            capital: their files would be one where a file system does not distinguish these.
    """
    cases, whys = [], []
    for name in names:
        try:
            cases.append(load_case(name))
        except CaseError as error:
            whys.append(str(error))
    if whys:
        raise CaseError("; ".join(whys))
    seen: dict[str, Path] = {}
    for case in cases:
        other = seen.setdefault(case.name.casefold(), case.path)
        if other is not case.path:
            where = "twice" if other == case.path else f"by {other} and {case.path}"
            raise CaseError(
                f"a case {case.name!r} is given {where}; name it once, or rename a file"
            )
    return cases


@dataclass(frozen=True)
class NearTool:
    """A mesh that is refined where tools press, to edges of a length [m], or one that follows.

    A motion on it has steps of `time_step` [s]; each simulator's own where None.
    """

    edge: float | None
    time_step: float | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """A case file that was read; mesh and problem are built when first asked for.

    Attributes:
        path: Path of the file.
        spec: The tables of the file.
        text: Its text as it was read: a simulator may change the file while it is judged.
        other_law: A law that the body follows instead of the case's own; see `under`.
        other_contact: Where contact is on every tool instead of where the case says; see
            `with_contact`.
        near_tool: Whether, and how, the mesh is refined where tools press; see `near_tools`.
    """

    path: Path
    spec: CaseSpec
    text: str
    other_law: Law | None = None
    other_contact: ContactRule | None = None
    near_tool: NearTool | None = None

    @property
    def name(self) -> str:
        """The file's name without its ending, and law, contact and mesh that are not the file's."""
        finer = None if self.near_tool is None else "near-tool"
        return "-".join(filter(None, (self.path.stem, self.other_law, self.other_contact, finer)))

    @property
    def is_changed(self) -> bool:
        """Whether law or contact is not the file's."""
        return any((self.other_law, self.other_contact))

    def under(self, law: Law) -> Case:
        """The same case of a body with the same moduli at rest that follows another law.

        Published numbers are of the case's own law: they are not checked.

        Raises:
            InputError: The law has constants that the case does not give.
        """
        if law is self.spec.material.law:
            return self
        if law.has_c01:
            raise InputError(
                f"{self.path.name} has no c10, c01 and bulk_modulus: state {law} in the case"
            )
        return replace(self, other_law=law)

    def with_contact(self, rule: ContactRule) -> Case:
        """The same case with contact of every tool at vertices, or over facets.

        Raises:
            InputError: The case has no tool.
        """
        if not self.spec.tool:
            raise InputError(f"{self.path.name} has no [tool], whose contact could be at {rule}")
        is_same = all(tool.contact is rule for tool in self.spec.tool)
        return self if is_same else replace(self, other_contact=rule)

    def near_tools(self, edge: float | None = None) -> Case:
        """The same case on its mesh with small cells where tools press.

        Args:
            edge: Length of edges there [m]; where None, half of the radius of contact, see
                `palpate.fastsim.grading.near_tools`.

        Raises:
            InputError: The case has no tool.
        """
        if not self.spec.tool:
            raise InputError(f"{self.path.name} has no [tool], near which cells could be refined")
        return replace(self, near_tool=NearTool(edge))

    @property
    def folder(self) -> Path:
        """The folder of the file; paths in the file may not leave it."""
        return self.path.parent

    @property
    def files(self) -> tuple[Path, ...]:
        """The case file and every file it names, whether there or not."""
        geometry = self.spec.geometry
        names = (
            geometry.mesh,
            geometry.surface,
            self.spec.truth.surface,
            *(tool.surface for tool in self.spec.tool),
            *(inclusion.surface for inclusion in self.spec.inclusion),
            *(file for measurement in self.spec.measurement for file in measurement.files),
        )
        return (self.path, *(self.folder / name for name in names if name is not None))

    @property
    def is_builtin(self) -> bool:
        """Whether it came with palpate."""
        return self.folder == builtin_folder()

    @property
    def beside(self) -> Path | None:
        """Beside what its references lie; None of a built-in case."""
        return None if self.is_builtin else self.folder

    @property
    def file(self) -> str:
        """The case's file as seen from the working folder, where it lies below it."""
        path, here = self.path.absolute(), Path.cwd()
        return str(path.relative_to(here) if path.is_relative_to(here) else path.name)

    @property
    def called(self) -> str:
        """What it is called on the command line: by its name, or its file."""
        return self.name if self.is_builtin else self.file

    @property
    def mesh_origin(self) -> str:
        """A line on who made the mesh, and what it became near tools."""
        if self.near_tool is None:
            return self.mesh.origin
        edge = self.near_tool.edge
        wanted = "half of the radius of contact" if edge is None else f"{1e3 * edge:g} mm"
        return (
            f"{self.mesh.origin}; refined near tools to edges of {wanted}, from "
            f"{self.mesh.mesh.num_cells} to {self.problem.mesh.num_cells} cells"
        )

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
        """The checks of the case; without those of published numbers under another law."""
        if self.other_law is None:
            return self.spec.check
        return tuple(check for check in self.spec.check if not check.about.is_published)

    @cached_property
    def mesh(self) -> BuiltMesh:
        """The mesh, and a line on who made it; InputError for what cannot be read or meshed."""
        return self._built(None)

    def build(self, progress: Callable[[str], None]) -> BuiltMesh:
        """The mesh; what takes more than two seconds calls `progress` with how much is done."""

        def per_cents(line: str) -> None:
            if line.endswith("%"):
                progress(line)

        if "mesh" not in self.__dict__:
            self.__dict__["mesh"] = self._built(per_cents)  # as the cached property would
        return self.mesh

    def _built(self, progress: Callable[[str], None] | None) -> BuiltMesh:
        from palpate.validation.case.meshing import BuiltMesh, build_mesh

        units = self.spec.units
        with units.in_own_words():
            built = build_mesh(self.spec, self.folder, progress)
        return BuiltMesh(built.mesh, units.in_case_units(built.origin))

    @cached_property
    def problem(self) -> Problem:
        """Mesh, materials, supports, loads and tools in SI units.

        Raises:
            InputError: A region that selects nothing, a body that floats, a bad value, a check
                at a position where the mesh has no point, or of a part that is not there.
        """
        from palpate.validation.case.problem import build_problem

        units = self.spec.units
        try:
            problem = build_problem(self.spec, self.folder, self.mesh.mesh)
            if self.other_law is not None:
                problem = with_law(problem, self.other_law)
            if self.other_contact is not None:
                tools = (replace(tool, contact=self.other_contact) for tool in problem.tools)
                problem = replace(problem, tools=tuple(tools))
            if self.near_tool is not None:
                from palpate.fastsim.grading.near_tools import refine_near_tools

                problem = refine_near_tools(problem, self.near_tool.edge)
                if problem.time is not None:
                    steps = replace(problem.time, time_step=self.near_tool.time_step)
                    problem = replace(problem, time=steps)
            for number, check in enumerate(self.checks, 1):
                if check.at is not None:
                    point_at(problem.mesh, check.at, units, f"check {number}")
                part_of_check(check, problem, units, f"check {number}")
            return problem
        except InputError as error:
            error.args = (f"{self.path.name}: {units.in_case_units(str(error))}",)
            raise
