"""The candidates: fastsim, and any program that reads a case folder and writes a result."""

from palpate.validation.simulators.answer import Answer, CandidateFailedError, Progress
from palpate.validation.simulators.fastsim import Fault, run_fastsim

__all__ = ["Answer", "CandidateFailedError", "Fault", "Progress", "run_fastsim"]
