"""Solve every variant with both strains, in order of the load, up to where equilibrium ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from palpate.meshes.problem import Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.simulators.answer import CandidateFailedError
from palpate.validation.solving import Simulator, solve
from palpate.validation.states import State
from palpate.validation.sweeps.variants import Axis, Variant


@dataclass(frozen=True, eq=False)
class Run:
    """One variant by one simulator with one strain.

    Attributes:
        values: One for each axis.
        simulator: Who solved.
        strain: With which law.
        state: The answer, None where there is none.
        trouble: Why there is none; "not tried: ..." beyond where equilibrium ends.
        was_tried: Whether it was solved at all.
    """

    values: tuple[float, ...]
    simulator: Simulator
    strain: Strain
    state: State | None
    trouble: str = ""
    was_tried: bool = True


def run_all(
    axes: Sequence[Axis],
    found: Sequence[Variant],
    simulators: Sequence[Simulator],
    *,
    jobs: int = 1,
    progress: Callable[[str], None],
) -> list[Run]:
    """Solve all of them, several at a time where asked.

    Where the first axis is a load, its values are taken from the smallest on, for each
    combination of the others: once there is no equilibrium, larger loads are not tried.

    Raises:
        ReferenceUnavailableError: The reference is asked for, and not here.
        InputError: A problem that one of them cannot be asked.
    """
    chains: list[tuple[list[Variant], Simulator, Strain]] = []
    for simulator in simulators:
        for strain in Strain:
            if not axes[0].is_load:
                chains += [([variant], simulator, strain) for variant in found]
                continue
            for others in dict.fromkeys(variant.values[1:] for variant in found):
                row = [variant for variant in found if variant.values[1:] == others]
                for sign in (row_part for row_part in _by_sign(row) if row_part):
                    chains.append((sign, simulator, strain))
    with ThreadPoolExecutor(jobs) as pool:  # both leave Python while they solve
        waiting = [pool.submit(_run_chain, axes, *chain, progress) for chain in chains]
        try:
            return [run for future in waiting for run in future.result()]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _by_sign(row: list[Variant]) -> tuple[list[Variant], list[Variant]]:
    """Loads of either sign, each from the smallest on."""
    ordered = sorted(row, key=lambda variant: abs(variant.values[0]))
    return (
        [variant for variant in ordered if variant.values[0] >= 0.0],
        [variant for variant in ordered if variant.values[0] < 0.0],
    )


def _run_chain(
    axes: Sequence[Axis],
    row: list[Variant],
    simulator: Simulator,
    strain: Strain,
    progress: Callable[[str], None],
) -> list[Run]:
    runs: list[Run] = []
    end = ""
    for variant in row:
        told = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes, variant.values, strict=True))
        if end:
            runs.append(Run(variant.values, simulator, strain, None, end, was_tried=False))
            continue
        progress(f"{simulator}, {strain} strain, {told}")
        try:
            state = solve(variant.case.problem, with_=simulator, strain=strain)
        except ReferenceUnavailableError:
            raise
        except (CandidateFailedError, ReferenceFailedError) as error:
            trouble = variant.case.spec.units.in_case_units(str(error))
            runs.append(Run(variant.values, simulator, strain, None, trouble))
            if axes[0].is_load:
                end = f"not tried: no answer at {axes[0].key} = {variant.values[0]:g}"
            continue
        runs.append(Run(variant.values, simulator, strain, state))
    return runs


def linear_error(run: Run, runs: Sequence[Run]) -> float | None:
    """How far a linear answer is from the Green one, relative L2 of displacement [-]."""
    if run.state is None:
        return None
    for other in runs:
        is_its_green = other.strain is Strain.GREEN and other.state is not None
        if is_its_green and (other.simulator, other.values) == (run.simulator, run.values):
            return difference(run.state, other.state)
    return None


def difference(one: State | None, other: State | None) -> float:
    """Relative L2 of displacement [-], of the other's."""
    assert one is not None
    assert other is not None
    scale = float(np.linalg.norm(other.displacement))
    return float(np.linalg.norm(one.displacement - other.displacement)) / (scale or 1.0)
