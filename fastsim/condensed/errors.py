"""What the condensed model refuses, with the numbers that show it."""

from __future__ import annotations

from palpate.fastsim.errors import FastsimError
from palpate.meshes.errors import InputError


class NotCondensableError(InputError):
    """A problem that the condensed linear model cannot pose; the message says what to do."""


class CondensedTooLargeError(InputError):
    """More memory than is allowed, told before any of it is taken.

    Attributes:
        needed_bytes: While the model is built.
        allowed_bytes: The limit.
    """

    def __init__(self, needed_bytes: int, allowed_bytes: int, about: str) -> None:
        self.needed_bytes = needed_bytes
        self.allowed_bytes = allowed_bytes
        super().__init__(
            f"condensing needs {needed_bytes / 1e6:.0f} MB ({about}), more than the "
            f"{allowed_bytes / 1e6:.0f} MB allowed; name fewer touched points (the `region` of a "
            "case's tool), or allow more (most_bytes)"
        )


class UnsettledContactError(FastsimError):
    """A step in which contact did not settle; the model is as it was before the step.

    Attributes:
        iterations: Newton iterations of the step.
        error: Gap or displacement by which the last of them was wrong [m].
    """

    def __init__(self, iterations: int, error: float) -> None:
        self.iterations = iterations
        self.error = error
        super().__init__(
            f"contact did not settle in {iterations} iterations (wrong by {error:.2g} m); move the "
            "tools less far in a step"
        )
