"""What the page and the server say to each other: small JSON messages in, frames out.

A frame is four bytes with the length of its head, the head as JSON, padded so that what follows
begins at a multiple of 8, and then for each pane positions of the surface's points, 16 bits for
each coordinate within a stated box, and shades, 8 bits a point.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from palpate.meshes.arrays import Points
from palpate.meshes.errors import InputError

# Of one message from the page [bytes]; the longest proper one has about 200.
MOST_BYTES = 2048
_STEPS = 65535
_ALIGNMENT = 8

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e7, le=1e7)]
Place = tuple[Number, Number, Number]
Count = Annotated[int, Field(strict=True, ge=0, le=2**53)]
Yes = Annotated[bool, Field(strict=True)]


class MessageError(InputError):
    """A message that is none of those that the page may send."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ToolTo(_Message):
    """Send the tool's origin to a place [mm]."""

    kind: Literal["tool"]
    number: Count
    to: Place


class Grab(_Message):
    """Hold the surface about one of its points, by a spring over a patch of a radius [mm]."""

    kind: Literal["grab"]
    point: Count
    radius: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e6)]


class Pull(_Message):
    """Send what is held by so much from where it was grabbed [mm]."""

    kind: Literal["pull"]
    number: Count
    by: Place


class LetGo(_Message):
    """Hold the surface no more."""

    kind: Literal["let_go"]


class Withdraw(_Message):
    """Take the tool out of the body and back to where it started; let go of the surface."""

    kind: Literal["withdraw"]


class Pause(_Message):
    """Stop the body's time, or let it go on."""

    kind: Literal["pause"]
    on: Yes


class Reset(_Message):
    """Back to rest."""

    kind: Literal["reset"]


class ColourBy(_Message):
    """What the surface is coloured by."""

    kind: Literal["colour"]
    by: Literal["displacement", "strain", "stress"]


class CaseLoads(_Message):
    """With the case's own loads, or without; both start from rest."""

    kind: Literal["loads"]
    on: Yes


class Record(_Message):
    """Begin a recording, at rest; or end it and write the case."""

    kind: Literal["record"]
    on: Yes


class JudgeThis(_Message):
    """Stop, and hold what is seen against the reference."""

    kind: Literal["judge"]


class Shown(_Message):
    """A frame was drawn."""

    kind: Literal["shown"]
    frame: Count


Message = (
    ToolTo
    | Grab
    | Pull
    | LetGo
    | Withdraw
    | Pause
    | Reset
    | ColourBy
    | CaseLoads
    | Record
    | JudgeThis
    | Shown
)
_MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def read_message(text: str | bytes) -> Message:
    """A message of the page.

    Raises:
        MessageError: Anything else: not text, too long, not JSON, an unknown key or kind, NaN, a
            number of another type or out of its range.
    """
    if not isinstance(text, str):
        raise MessageError("a message is text")
    if len(text) > MOST_BYTES:
        raise MessageError(f"a message has at most {MOST_BYTES} characters")
    try:
        return _MESSAGE.validate_json(text)
    except ValidationError as error:
        what = error.errors(include_url=False, include_input=False)[0]
        raise MessageError(f"no message: {what['msg']}") from None
    except (ValueError, RecursionError):
        raise MessageError("no message: not JSON") from None


class Box:
    """A box in which coordinates are told in whole numbers from 0 to 65535.

    Args:
        points: Of the body at rest [mm], shape (n, 3); the box is three times as large, so that a
            body may move by its own size.
    """

    def __init__(self, points: Points) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        side = float((high - low).max())
        self.origin = (low + high - 3.0 * side) / 2.0
        self.step = 3.0 * side / _STEPS

    def packed(self, places: Points) -> NDArray[np.uint16]:
        """Whole numbers of places [mm], shape (n, 3); what lies outside is on the box's side."""
        numbers = np.rint((places - self.origin) / self.step)
        packed: NDArray[np.uint16] = np.clip(numbers, 0, _STEPS).astype("<u2")
        return packed

    def described(self) -> dict[str, Any]:
        """For the page: place = origin + step * number [mm]."""
        return {"origin": self.origin.tolist(), "step": self.step}


def pack_frame(
    head: dict[str, Any], panes: Sequence[tuple[NDArray[np.uint16], NDArray[np.uint8]]]
) -> bytes:
    """A frame from its head and each pane's numbers and shades (format above)."""
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNMENT)
    parts = [struct.pack("<I", len(text)), text]
    parts += [numbers.astype("<u2").tobytes() for numbers, _ in panes]
    parts += [shades.astype(np.uint8).tobytes() for _, shades in panes]
    return b"".join(parts)


def unpack_frame(
    data: bytes, num_points: int
) -> tuple[dict[str, Any], list[NDArray[np.uint16]], list[NDArray[np.uint8]]]:
    """Head, numbers (num_points, 3) and shades (num_points,) of each pane: a client's side."""
    (length,) = struct.unpack_from("<I", data)
    head: dict[str, Any] = json.loads(data[4 : 4 + length])
    begin, count = 4 + length, len(head["panes"])
    numbers = np.frombuffer(data, "<u2", count * num_points * 3, begin)
    shades = np.frombuffer(data, np.uint8, count * num_points, begin + numbers.nbytes)
    return head, list(numbers.reshape(count, -1, 3)), list(shades.reshape(count, -1))
