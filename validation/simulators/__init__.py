"""The candidates: fastsim, and any program that reads a case folder and writes a result."""

from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress
from palpate.validation.simulators.fastsim import run_fastsim
from palpate.validation.simulators.faults import Fault

__all__ = ["Answer", "CandidateFailedError", "Fault", "Progress", "run_fastsim"]
