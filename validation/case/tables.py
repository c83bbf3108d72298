"""What may stand in the tables of a case file, as the schema's models have it."""

from __future__ import annotations

import types
from enum import Enum
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo


def keys_of(model: type[BaseModel]) -> list[tuple[str, FieldInfo]]:
    """By the names in a file; `kind` first, and plain text tables as they stand."""
    fields = [(field.alias or name, field) for name, field in model.model_fields.items()]
    return sorted(fields, key=lambda pair: pair[0] != "kind")


def plain_kind(annotation: Any) -> Any:
    """Without what validates it and without None."""
    if get_origin(annotation) is Annotated:
        return plain_kind(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        others = [a for a in get_args(annotation) if a is not types.NoneType]
        return plain_kind(others[0]) if len(others) == 1 else annotation
    return annotation


def tables_of(field: FieldInfo) -> list[type[BaseModel]]:
    """The kinds of table that may stand there; none for a plain value."""
    kind = plain_kind(field.annotation)
    if get_origin(kind) is tuple:
        kind = plain_kind(get_args(kind)[0])
    kinds = [plain_kind(k) for k in get_args(kind)] if get_origin(kind) is not Literal else []
    return [k for k in (kinds or [kind]) if isinstance(k, type) and issubclass(k, BaseModel)]


def choices_of(field: FieldInfo) -> list[Any]:
    """The words that may stand there; none where it is no choice."""
    kind = plain_kind(field.annotation)
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    return list(kind) if isinstance(kind, type) and issubclass(kind, Enum) else []
