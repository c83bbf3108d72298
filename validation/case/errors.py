"""What is wrong with a case file, in at most two lines: file, line, key, value, remedy."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from palpate.meshes.errors import InputError
from palpate.validation.case import motion_schema
from palpate.validation.case import region_schema as regions_schema
from palpate.validation.case import schema as case_schema
from palpate.validation.case.schema import CaseSpec


class CaseError(InputError):
    """A case file that cannot be used; the message names file, line, key and remedy."""


def explain(path: Path, source: str, data: dict[str, Any], error: ValidationError) -> str:
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
    return [
        value
        for schema in (case_schema, motion_schema, regions_schema)
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
