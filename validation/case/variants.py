"""A case with other values: numbers by their path in its file; nothing is evaluated."""

from __future__ import annotations

import difflib
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from palpate.meshes.errors import InputError
from palpate.meshes.untrusted import parse_toml
from palpate.validation.case.load import Case, CaseError, explain
from palpate.validation.case.schema import CaseSpec, input_names

MOST_RUNS = 10_000
# What `load[0].factor` multiplies.
LOAD_SIZES = ("force", "traction", "moment", "pressure", "acceleration")
_FACTOR = re.compile(r"load\[(\d+)\]\.factor")
_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


class VaryError(InputError):
    """A --vary that cannot be used; `.words` holds it as it was given."""

    def __init__(self, words: str, reason: str) -> None:
        self.words = words
        super().__init__(f"--vary {words!r}: {reason}")


@dataclass(frozen=True)
class Axis:
    """A number of the case, and the values it takes."""

    key: str
    values: tuple[float, ...]

    @property
    def is_load(self) -> bool:
        """Whether more of it is more load: past the end of equilibrium there is no more."""
        return self.key.startswith("load[") and ".region" not in self.key


@dataclass(frozen=True, eq=False)
class Variant:
    """A case with one value for each axis, in their order."""

    values: tuple[float, ...]
    case: Case


def read_values(words: str) -> tuple[float, ...]:
    """The numbers of `KEY=0.3,0.4` or `KEY=0.1:2:10` (first, last, how many).

    Raises:
        VaryError: No numbers, none at all, or one twice.
    """
    _, equals, text = (part.strip() for part in words.partition("="))
    if not equals or not text:
        raise VaryError(words, "write KEY=FIRST:LAST:COUNT or KEY=VALUE,VALUE,...")
    try:
        if ":" in text:
            first, last, count = text.split(":")
            n = int(count) if 2 <= int(count) <= MOST_RUNS else 0
            start, width = float(first), float(last) - float(first)
            values = tuple(start + width * k / (n - 1) for k in range(n))
        else:
            values = tuple(float(word) for word in text.split(","))
    except (ValueError, OverflowError):
        raise VaryError(words, "write numbers: FIRST:LAST:COUNT or VALUE,VALUE,...") from None
    if not values or not all(math.isfinite(value) for value in values):
        raise VaryError(words, "needs finite numbers, and a count from 2 to 10000")
    if len(set(values)) < len(values):
        raise VaryError(words, "gives a value twice")
    return values


def read_axis(words: str, case: Case) -> Axis:
    """`material.poissons_ratio=0.3,0.4` or `load[0].factor=0.1:2:10` (first, last, how many).

    Raises:
        VaryError: An unknown key, which gets a suggestion, or values that are no numbers.
    """
    key, equals, _ = (part.strip() for part in words.partition("="))
    if equals:
        try:
            require_keys(case, [key])
        except InputError as error:
            raise VaryError(words, str(error)) from None
    return Axis(key, read_values(words))


def variants(case: Case, axes: Sequence[Axis]) -> list[Variant]:
    """Every combination of values; each is built, so that a bad one is refused before a solve.

    Raises:
        VaryError: No axis, one twice, or too many combinations.
        InputError: A value that the case cannot take.
    """
    if not axes:
        raise InputError("say what varies: --vary KEY=FIRST:LAST:COUNT")
    keys = [axis.key for axis in axes]
    for axis in axes:
        if keys.count(axis.key) > 1:
            raise VaryError(axis.key, "is given twice")
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_RUNS:
        raise InputError(f"{count} combinations; at most {MOST_RUNS} are solved")
    made = []
    for values in itertools.product(*(axis.values for axis in axes)):
        made.append(Variant(values, with_values(case, dict(zip(keys, values, strict=True)))))
    return made


def with_values(case: Case, values: Mapping[str, float], *, like: Case | None = None) -> Case:
    """The case with other numbers, its problem built.

    Args:
        case: The case.
        values: Numbers by key, such as `mass[0].mass`, in the case's units.
        like: A case whose mesh is used again where geometry and mesh are stated alike; the case
            itself where None.

    Raises:
        InputError: An unknown key, or a value that the case cannot take.
    """
    require_keys(case, values)
    data = parse_toml(case.text)
    for key, value in values.items():
        put_value(data, key, value)
    try:
        spec = CaseSpec.model_validate(data)
    except ValidationError as error:
        raise CaseError(explain(case.path, case.text, data, error)) from error
    changed = replace(case, spec=spec)
    known = like or case
    if (spec.geometry, spec.mesh) == (known.spec.geometry, known.spec.mesh):
        changed.__dict__["mesh"] = known.mesh
    _ = changed.problem
    return changed


def read_settings(words: Sequence[str]) -> dict[str, float]:
    """The numbers of `KEY=VALUE`, one each.

    Raises:
        InputError: Not of this form, or a key twice.
    """
    found: dict[str, float] = {}
    for text in words:
        key, equals, value = (part.strip() for part in text.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not equals or not math.isfinite(number):
            raise InputError(f"--set {text!r}: write KEY=VALUE, a finite number")
        if key in found:
            raise InputError(f"--set {key} is given twice")
        found[key] = number
    return found


def is_factor(key: str) -> bool:
    """Whether a key multiplies a load, as `load[0].factor` does."""
    return _FACTOR.fullmatch(key) is not None


def value_of(case: Case, key: str) -> float:
    """The number that a case gives for a key of `known_keys`, in its units; 1 for a factor."""
    if is_factor(key):
        return 1.0
    return float(_look(case.spec.model_dump(exclude_unset=True), key))


def require_keys(case: Case, keys: Iterable[str], what: str = "") -> None:
    """Refuse keys that the case gives no number for.

    Raises:
        InputError: The first of them, with the nearest known one.
    """
    known = known_keys(case)
    for key in keys:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(known)}"
            before = f"{what}: " if what else ""
            raise InputError(f"{before}the case gives no number {key!r}; {hint}")


def known_keys(case: Case) -> list[str]:
    """Numbers that the file gives, components of rows, and a factor on each load."""
    tables = case.spec.model_dump(exclude_unset=True)
    keys = [f"load[{k}].factor" for k in range(len(case.spec.load))]
    for name in input_names(case.spec):
        found = _look(tables, name)
        if isinstance(found, list | tuple):
            keys += [f"{name}[{k}]" for k in range(len(found))]
        else:
            keys.append(name)
    return keys


def _steps(key: str) -> list[str | int]:
    return [name or int(index) for name, index in _STEP.findall(key)]


def _look(tables: Any, key: str) -> Any:
    for step in _steps(key):
        tables = tables[step]
    return tables


def put_value(data: dict[str, Any], key: str, value: float) -> None:
    """Set a number of a case file, which may write [tool] for one [[tool]]."""
    if found := _FACTOR.fullmatch(key):
        load = data["load"][int(found[1])]
        for table in load.get("values", [load]):
            (size,) = (name for name in LOAD_SIZES if name in table)
            whole = table[size]
            table[size] = [value * x for x in whole] if isinstance(whole, list) else value * whole
        return
    *way, last = _steps(key)
    entry: Any = data
    for step in way:
        entry = entry if isinstance(step, int) and isinstance(entry, dict) else entry[step]
    is_count = isinstance(entry[last], int) and float(value).is_integer()
    entry[last] = int(value) if is_count else value
