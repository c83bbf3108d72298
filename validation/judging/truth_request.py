"""What a case asks of its stored truth: small bars of what it checks."""

from __future__ import annotations

from palpate.meshes.problem import Strain
from palpate.validation.case import Case
from palpate.validation.case.regions import part_of_check
from palpate.validation.judging.published import metric_of_bar
from palpate.validation.metrics import Part
from palpate.validation.references.adaptive_truth import TruthRequest


def truth_request(case: Case) -> TruthRequest:
    """The bar and budget of a case's [truth], for the metrics whose bars its checks use.

    Raises:
        InputError: A check names a part of the body that is not there.
    """
    asked, problem, units = case.spec.truth, case.problem, case.spec.units
    metrics: dict[Strain, set[str]] = {strain: set() for strain in Strain}
    parts: dict[Strain, list[tuple[str, Part]]] = {strain: [] for strain in Strain}
    for number, spec in enumerate(case.checks, start=1):
        if spec.against != "truth":
            continue
        strain = spec.strain or case.strain
        part = part_of_check(spec, problem, units, f"check {number}")
        if part is None or not spec.about.is_of_integrals:
            metrics[strain].add(metric_of_bar(spec))
        else:
            parts[strain].append((metric_of_bar(spec), part))
    return TruthRequest(asked.bar, 60.0 * asked.minutes, asked.memory, metrics, parts=parts)
