"""What a case asks of its stored truth: small bars of what it checks."""

from __future__ import annotations

from palpate.meshes.problem import Strain
from palpate.validation.case import Case
from palpate.validation.judging.published import metric_of_bar
from palpate.validation.references.adaptive_truth import TruthRequest


def truth_request(case: Case) -> TruthRequest | None:
    """The bar and budget of a case's [truth], for the metrics whose bars its checks use.

    None where stress, a reaction or an energy is checked, which meshes refined for displacements
    do not tell.
    """
    asked = case.spec.truth
    against = [spec for spec in case.checks if spec.against == "truth"]
    if any(spec.about.is_of_integrals for spec in against):
        return None
    metrics = {
        strain: {metric_of_bar(s) for s in against if (s.strain or case.strain) is strain}
        for strain in Strain
    }
    return TruthRequest(asked.bar, 60.0 * asked.minutes, asked.memory, metrics)
