"""What is wrong with a case file, in at most two lines: file, line, key, value, remedy."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from palpate.meshes.errors import InputError
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.tables import choices_of, keys_of, tables_of


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
    place = [part for index, part in enumerate(loc) if not _is_tag(index, loc)]
    context = found.get("ctx", {})
    place += context.get("place", ())
    key = ".".join(str(part + 1) if isinstance(part, int) else part for part in place)
    # What is missing stands nowhere: the table where it should.
    stands = place[:-1] if found["type"] == "missing" else place
    where = f"{path}:{_line_of(source, stands)}"
    match found["type"]:
        case "extra_forbidden":
            hint = _suggestion(str(place[-1]), _siblings(loc)) or "remove it"
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
            if place[-1] == "size":
                message += "; cells are sized by edge_length"
        case "published":
            return f"{where}: {key!r} {found['msg']}"
        case _:
            message = found["msg"].removeprefix("Value error, ")
    return f"{where}: {key or 'case'}{_value(found.get('input'))}: {message}"


def _value(value: Any) -> str:
    """As it stands in the file, where it is short enough to be shown."""
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
    """The word that was meant, as a question; empty where nobody can tell."""
    near = difflib.get_close_matches(word, known, n=1)
    near = near or difflib.get_close_matches(word.lower(), known, n=1)
    near = near or [key for key, others in _ALSO_CALLED.items() if word.lower() in others]
    return f"did you mean {near[0]!r}?" if near and near[0] in known else ""


_MOST_SHOWN = 60
# What others call a key of ours, where the spelling does not tell.
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
    """Pydantic puts the kind of a load into the place: load.0.force.region."""
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
