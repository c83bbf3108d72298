"""What may stand in the tables of a case file, as the schema's models have it."""

from __future__ import annotations

import types
from enum import Enum
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from palpate.validation.case.schema import CaseSpec


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


def editor_schema() -> dict[str, Any]:
    """The schema as draft 7, which editors know; what stands in no TOML file is left out.

    What several keys must be together (one of shape, surface and mesh, say) is checked by
    `palpate check` only.
    """
    schema = _plain(CaseSpec.model_json_schema())
    assert isinstance(schema, dict)
    tool = schema["properties"]["tool"]
    one_or_more = [tool["items"], {"type": "array", "items": tool["items"]}]
    schema["properties"]["tool"] = {"description": tool["description"], "anyOf": one_or_more}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        **schema,
        "title": "A case of palpate",
        "description": "A body with supports and loads, and what of the result is checked.",
    }


def _plain(part: Any) -> Any:
    """Without nulls, which TOML has not, and without what later drafts brought."""
    if isinstance(part, list):
        return [_plain(item) for item in part]
    if not isinstance(part, dict):
        return part
    found = {key: _plain(value) for key, value in part.items() if not _is_left_out(key, value)}
    if "prefixItems" in found:
        found["items"] = found.pop("prefixItems")
    choices = [choice for choice in found.get("anyOf", []) if choice != {"type": "null"}]
    if len(choices) == 1:
        del found["anyOf"]
        found = {**choices[0], **found}
    elif choices:
        found["anyOf"] = choices
    return found


def _is_left_out(key: str, value: Any) -> bool:
    """Titles that repeat the key's name, pydantic's own words, and defaults that are none."""
    is_title = key == "title" and isinstance(value, str)
    is_own = key == "discriminator" and "mapping" in value
    return is_title or is_own or (key == "default" and value is None)
