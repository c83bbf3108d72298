"""Values of a case by name, as its author writes them: `material.density`, `load[0].force`."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

# What is judged and said, not what is solved.
_NOT_INPUTS = ("schema_version", "title", "description", "check", "evidence", "published")


def input_names(spec: BaseModel) -> list[str]:
    """Names of every number, or row of numbers, that a case file gives to be solved with."""
    tables = spec.model_dump(exclude_unset=True, exclude=set(_NOT_INPUTS))
    return [name for key, value in tables.items() for name in _names(key, value)]


def require_inputs(spec: BaseModel, names: tuple[str, ...], what: str) -> None:
    """Raise ValueError at the first name, of those in `what`, that the case does not give."""
    given = input_names(spec)
    for name in names:
        if name in given:
            continue
        near = difflib.get_close_matches(name, given, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"it gives {', '.join(given)}"
        raise ValueError(f"{what}: the case gives no number {name!r}; {hint}")


def _names(key: str, value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for inner, found in value.items():
            yield from _names(f"{key}.{inner}", found)
    elif _is_number(value):
        yield key
    elif isinstance(value, list | tuple):
        if all(map(_is_number, value)):
            yield key
        else:
            for place, found in enumerate(value):
                yield from _names(f"{key}[{place}]", found)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
