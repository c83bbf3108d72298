"""The condensed linear model: a body's compliance at its surface, for steps at haptic rate."""

from palpate.fastsim.condensed.condense import (
    MOST_BYTES,
    condense,
    condense_once,
    condensed_size,
    load_condensed,
)
from palpate.fastsim.condensed.model import CondensedModel
from palpate.fastsim.condensed.setup import (
    CompliancePrecision,
    CondensedSize,
    CondensedTooLargeError,
    NotCondensableError,
    UnsettledContactError,
)
from palpate.fastsim.condensed.solve import CondensedResult, solve_condensed
from palpate.fastsim.condensed.steps import CondensedBody, CondensedSteps, StepState

__all__ = [
    "MOST_BYTES",
    "CompliancePrecision",
    "CondensedBody",
    "CondensedModel",
    "CondensedResult",
    "CondensedSize",
    "CondensedSteps",
    "CondensedTooLargeError",
    "NotCondensableError",
    "StepState",
    "UnsettledContactError",
    "condense",
    "condense_once",
    "condensed_size",
    "load_condensed",
    "solve_condensed",
]
