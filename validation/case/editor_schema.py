"""The keys of a case file as a JSON Schema, by which editors check and complete."""

from __future__ import annotations

from typing import Any

from palpate.validation.case.schema import CaseSpec


def editor_schema() -> dict[str, Any]:
    """The schema as draft 7, which editors know; what stands in no TOML file is left out.

    What several keys must be together (one of shape, surface and mesh, say) is told by
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
        "description": "A body that is held and pushed, and what of the answer is checked.",
    }


def _plain(part: Any) -> Any:
    """Without nulls, which TOML has not, and without what later drafts brought."""
    if isinstance(part, list):
        return [_plain(item) for item in part]
    if not isinstance(part, dict):
        return part
    kept = {key: _plain(value) for key, value in part.items() if not _is_left_out(key, value)}
    if "prefixItems" in kept:
        kept["items"] = kept.pop("prefixItems")
    choices = [choice for choice in kept.get("anyOf", []) if choice != {"type": "null"}]
    if len(choices) == 1:
        del kept["anyOf"]
        kept = {**choices[0], **kept}
    elif choices:
        kept["anyOf"] = choices
    return kept


def _is_left_out(key: str, value: Any) -> bool:
    """Titles that repeat the key's name, pydantic's own words, and defaults that are none."""
    is_title = key == "title" and isinstance(value, str)
    is_own = key == "discriminator" and "mapping" in value
    return is_title or is_own or (key == "default" and value is None)
