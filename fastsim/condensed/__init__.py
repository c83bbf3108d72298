"""The condensed linear model: a body's compliance at its surface, for steps at haptic rate."""

from palpate.fastsim.condensed.condense import MOST_BYTES as MOST_BYTES
from palpate.fastsim.condensed.condense import condense as condense
from palpate.fastsim.condensed.condense import condense_once as condense_once
from palpate.fastsim.condensed.condense import condensed_size as condensed_size
from palpate.fastsim.condensed.condense import load_condensed as load_condensed
from palpate.fastsim.condensed.model import CondensedModel as CondensedModel
from palpate.fastsim.condensed.setup import CompliancePrecision as CompliancePrecision
from palpate.fastsim.condensed.setup import CondensedSize as CondensedSize
from palpate.fastsim.condensed.setup import CondensedTooLargeError as CondensedTooLargeError
from palpate.fastsim.condensed.setup import NotCondensableError as NotCondensableError
from palpate.fastsim.condensed.setup import UnsettledContactError as UnsettledContactError
from palpate.fastsim.condensed.solve import CondensedResult as CondensedResult
from palpate.fastsim.condensed.solve import solve_condensed as solve_condensed
from palpate.fastsim.condensed.steps import CondensedBody as CondensedBody
from palpate.fastsim.condensed.steps import CondensedSteps as CondensedSteps
from palpate.fastsim.condensed.steps import StepState as StepState
