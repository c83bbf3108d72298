"""Numbers of a case or result file: numbers, and nothing that could be taken for one.

`true` is 1 and "1e300" is a number to many a reader; a limit of either lets anything pass.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from palpate.meshes.untrusted_text import is_a_float

# What a float64 and a machine word both hold without loss.
LARGEST_COUNT = 2**53


def plain_number(value: Any) -> Any:
    """A finite number, as it stands; anything else is refused."""
    if isinstance(value, bool):
        raise PydanticCustomError("number", "is a truth value; write a number")
    if isinstance(value, str):
        raise PydanticCustomError("number", "is text; write the number without quotes")
    if not isinstance(value, int | float):
        raise PydanticCustomError("number", "is no number")
    if not is_a_float(value):
        is_whole = isinstance(value, int)
        message = "is beyond what a float can hold" if is_whole else "is not finite"
        raise PydanticCustomError("number", f"{message}; write a finite number")
    return value


def _plain_count(value: Any) -> Any:
    plain_number(value)
    if not isinstance(value, int):
        raise PydanticCustomError("number", "must be a whole number, without a point")
    if abs(value) > LARGEST_COUNT:
        raise PydanticCustomError("number", "is too large to count with")
    return value


def _truth_value(value: Any) -> Any:
    if not isinstance(value, bool):
        raise PydanticCustomError("truth_value", "must be true or false, without quotes")
    return value


Number = Annotated[float, BeforeValidator(plain_number)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Count = Annotated[int, BeforeValidator(_plain_count)]
Flag = Annotated[bool, BeforeValidator(_truth_value)]
Vector = tuple[Number, Number, Number]


def _usable(value: Any) -> Any:
    """Refuse what cannot be written out as JSON, with the place where it stands."""
    _require_usable(value, ())
    return value


def _require_usable(value: Any, place: tuple[str | int, ...]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _require_usable(item, (*place, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _require_usable(item, (*place, index))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        if not is_a_float(value):
            raise PydanticCustomError(
                "published", "is no finite number", {"place": place, "value": repr(value)}
            )
    elif not isinstance(value, str | bool):
        kind = type(value).__name__
        raise PydanticCustomError(
            "published", f"is a {kind}; write it as text, in quotes", {"place": place}
        )


# Text, truth values, finite numbers, and lists and tables of them.
PlainData = Annotated[dict[str, Any], AfterValidator(_usable)]
