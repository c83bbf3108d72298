"""Diagnosis: what would explain a wrong result, tried one by one, and how well each fits."""

from palpate.validation.diagnosis.diagnose import diagnose
from palpate.validation.diagnosis.explanation import Cause, Diagnosis, Explanation

__all__ = ["Cause", "Diagnosis", "Explanation", "diagnose"]
