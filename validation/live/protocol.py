"""The messages that the page sends to the server: small, in JSON, and each checked."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from palpate.meshes.errors import InputError

# The largest message from the page [bytes]; the longest valid one has about 200.
MOST_BYTES = 2048

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e7, le=1e7)]
Position = tuple[Number, Number, Number]
Count = Annotated[int, Field(strict=True, ge=0, le=2**53)]


class MessageError(InputError):
    """The message is not one that the page may send."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ToolTo(_Message):
    """Send the tool's origin to a position [mm]."""

    kind: Literal["tool"]
    number: Count
    to: Position


class Grab(_Message):
    """Grab the surface about one of its points, by a spring over a patch of a radius [mm]."""

    kind: Literal["grab"]
    point: Count
    radius: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1e6)]


class Pull(_Message):
    """Pull the grabbed patch by a vector from where it was grabbed [mm]."""

    kind: Literal["pull"]
    number: Count
    by: Position


class Order(_Message):
    """An order that needs no numbers.

    let_go: release the surface; withdraw: also retract the tool from the body to its start; reset:
    return everything to rest; judge: stop, and compare the present pose with the reference.
    """

    kind: Literal["let_go", "withdraw", "reset", "judge"]


class Switch(_Message):
    """A switch that is on or off.

    pause: simulated time stands still; loads: the case's own loads act, from rest; record: begin a
    recording at rest, or end it and write the case.
    """

    kind: Literal["pause", "loads", "record"]
    on: Annotated[bool, Field(strict=True)]


class ColourBy(_Message):
    """The quantity that colours the surface."""

    kind: Literal["colour"]
    by: Literal["displacement", "strain", "stress"]


class Shown(_Message):
    """The page has drawn a frame."""

    kind: Literal["shown"]
    frame: Count


Message = ToolTo | Grab | Pull | Order | Switch | ColourBy | Shown
_MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def read_message(text: str | bytes) -> Message:
    """Read a message of the page.

    Raises:
        MessageError: It is not text, too long or not JSON; it has an unknown key or kind, NaN, a
            number of another type or one out of its range.
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
