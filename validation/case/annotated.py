"""A case file with every key in it, each with what the schema says of it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from palpate.validation.case.acting_schema import PointForceSpec
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.tables import choices_of, keys_of, plain_kind, tables_of
from palpate.validation.metrics import CATALOGUE

# Shown where a key has no default; words by name, all else by type.
_EXAMPLES: dict[str, Any] = {
    "surface": "probe.stl",
    "mesh": "liver.vtu",
    "group": "attachment",
    "fitted": ["material.youngs_modulus"],
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

    Args:
        values: As they stand in a case file; valid ones.
        remarks: A line above a table, by its name (`support`) or its name and number (`check 2`).
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
    if not field.is_required() and value is not None and value != () and value != {}:
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
        return "{ " + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(str(value), ensure_ascii=False)
    return repr(value)


def case_text(values: Mapping[str, Any]) -> str:
    """A case file without remarks: tables one below another, each key on a line."""
    lines = [f"{k} = {toml_value(v)}" for k, v in values.items() if not isinstance(v, dict | list)]
    for key, value in values.items():
        tables = value if isinstance(value, list) else [value] if isinstance(value, dict) else []
        header = f"[[{key}]]" if isinstance(value, list) else f"[{key}]"
        for table in tables:
            lines += ["", header, *(f"{k} = {toml_value(v)}" for k, v in table.items())]
    return "\n".join([*lines, ""])
