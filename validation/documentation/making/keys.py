"""The page of a case file's keys, from the schema that `palpate schema` writes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from making.tables import table
from palpate.validation.case.schema_keys import editor_schema


def keys() -> str:
    """Every key of a case file, from the schema that `palpate schema` writes."""
    schema = editor_schema()
    tables = {"": schema, **schema["$defs"]}
    parts = [
        "# Keys of a case file\n\nA case is a TOML file. Unknown keys are errors; lengths, "
        "stresses and forces are in the units of the file's own `[units]`. `palpate schema -o "
        "palpate.schema.json` writes this for editors.\n"
    ]
    for name, part in tables.items():
        title = _title(name)
        if "properties" in part:
            parts += [f"({_anchor(name)})=\n## {title}\n", f"{part.get('description', '')}\n"]
            required = set(part.get("required", ()))
            rows = [
                (f"`{key}`", _type(one), _default(key, one, required), one.get("description", ""))
                for key, one in part["properties"].items()
            ]
            parts.append(table(("key", "value", "default", "meaning"), rows))
        elif "enum" in part:
            values = ", ".join(f'`"{value}"`' for value in part["enum"])
            meaning = part.get("description", "").strip().splitlines()
            parts += [f"({_anchor(name)})=\n## {title}\n", f"{meaning[0] if meaning else ''}\n"]
            parts.append(f"One of {values}.\n")
    return "\n".join(parts)


def _title(name: str) -> str:
    """Of a table, for people: "SupportSpec" is "support"."""
    words = re.sub(r"(Spec|At)$", "", name)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words).lower() or "The file"


def _anchor(name: str) -> str:
    return f"key-{name.lower() or 'file'}"


def _type(part: Mapping[str, Any]) -> str:
    if "$ref" in part:
        name = str(part["$ref"]).rsplit("/", 1)[-1]
        return f"[{_title(name)}](#{_anchor(name)})"
    for several in ("anyOf", "oneOf"):
        if several in part:
            return " or ".join(dict.fromkeys(_type(one) for one in part[several]))
    if "enum" in part:
        return ", ".join(f'`"{value}"`' for value in part["enum"])
    if "const" in part:
        return f"`{part['const']}`"
    kind = part.get("type", "")
    if kind == "array":
        items = part.get("items", {})
        if isinstance(items, list):
            return f"{len(items)} of {_type(items[0])}"
        return f"list of {_type(items)}"
    limits = {"exclusiveMinimum": "> ", "minimum": ">= ", "gt": "> ", "maximum": "<= "}
    found = [f"{word}{part[key]:g}" for key, word in limits.items() if key in part]
    return " ".join([str(kind), *found]).strip() or "table"


def _default(key: str, part: Mapping[str, Any], required: set[str]) -> str:
    if key in required:
        return "required"
    value = part.get("default")
    if value is None or value in ({}, []) or isinstance(value, dict):
        return "-"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`" if value != "" else "-"
