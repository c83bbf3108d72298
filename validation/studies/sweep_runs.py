"""Solve every variant with both strains, in order of the load, up to where equilibrium ends."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.case.units import Units
from palpate.validation.solving import Simulator, solve
from palpate.validation.states import CandidateFailedError, Method, Progress, State, in_silence
from palpate.validation.studies.sweep_cluster import cluster
from palpate.validation.studies.sweep_variants import Axis, Variant


@dataclass(frozen=True, eq=False)
class Run:
    """One variant by one simulator with one element and one strain.

    Attributes:
        values: One for each axis.
        simulator: Who solved.
        element: With which tetrahedra.
        strain: With which law.
        state: The answer, None where there is none.
        trouble: Why there is none; "not tried: ..." beyond where equilibrium ends.
        was_tried: Whether it was solved at all.
    """

    values: tuple[float, ...]
    simulator: Simulator
    element: Element
    strain: Strain
    state: State | None
    trouble: str = ""
    was_tried: bool = True

    @property
    def who(self) -> str:
        """Simulator, and its element where it is not the linear one."""
        smoothed = self.element is not Element.LINEAR
        return f"{self.simulator} ({self.element})" if smoothed else str(self.simulator)


def run_all(
    axes: Sequence[Axis],
    found: Sequence[Variant],
    simulators: Sequence[Simulator],
    *,
    elements: Sequence[Element] = (Element.LINEAR,),
    device: str = "cpu",
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress,
) -> list[Run]:
    """Solve all of them, several at a time where asked.

    Where the first axis is a load, its values are taken from the smallest on, for each
    combination of the others: once there is no equilibrium, larger loads are not tried.

    Args:
        axes: What varies.
        found: The variants of them.
        simulators: Who solves each.
        elements: With which tetrahedra each of them does.
        device: Of fastsim's explicit steps; on others than "cpu" equilibrium is by relaxation.
        jobs: Runs at a time, on this machine.
        scheduler: Address of a dask scheduler, on whose workers all run instead.
        progress: Called with one line now and then.

    Returns:
        The runs, by simulator, element and strain; the same ones wherever they ran.

    Raises:
        ReferenceUnavailableError: The reference is asked for, and not there.
        InputError: A problem that one of them cannot be asked, or a scheduler of no use.
    """
    chains: list[_Chain] = []
    rows = _loads_from_the_smallest(found) if axes[0].is_load else [[v] for v in found]
    for simulator, element, strain in product(simulators, elements, Strain):
        if simulator is Simulator.CONDENSED and strain is not Strain.LINEAR:
            continue  # all that it knows
        for row in rows:
            given = [(variant.values, variant.case.problem) for variant in row]
            units = row[0].case.spec.units
            chains.append(_Chain(axes, given, units, simulator, element, strain, device))
    if scheduler is not None:
        with cluster(scheduler) as pool:
            waiting = [pool.submit(_Chain.run, chain) for chain in chains]
            for count, future in enumerate(as_completed(waiting), start=1):
                last = future.result()[-1]
                line = f"{last.who}, {last.strain} strain: {count} of {len(chains)} rows done"
                progress(line)
            return [run for future in waiting for run in future.result()]
    with ThreadPoolExecutor(jobs) as pool:  # both leave Python while they solve
        waiting = [pool.submit(chain.run, progress) for chain in chains]
        try:
            return [run for future in waiting for run in future.result()]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _loads_from_the_smallest(found: Sequence[Variant]) -> list[list[Variant]]:
    """Rows of loads of either sign, each from the smallest on."""
    rows = []
    for others in dict.fromkeys(variant.values[1:] for variant in found):
        row = [variant for variant in found if variant.values[1:] == others]
        row.sort(key=lambda variant: abs(variant.values[0]))
        rows.append([variant for variant in row if variant.values[0] >= 0.0])
        rows.append([variant for variant in row if variant.values[0] < 0.0])
    return [row for row in rows if row]


@dataclass(frozen=True, eq=False)
class _Chain:
    """Variants, by values and problem, that are solved one after the other.

    Plain data, that another machine can have.
    """

    axes: Sequence[Axis]
    row: Sequence[tuple[tuple[float, ...], Problem]]
    units: Units
    simulator: Simulator
    element: Element
    strain: Strain
    device: str = "cpu"

    def _solve(self, problem: Problem) -> State:
        ask = functools.partial(solve, problem, strain=self.strain, element=self.element)
        if self.device == "cpu" or self.simulator is not Simulator.FASTSIM:
            return ask(with_=self.simulator)
        method = Method.NEWTON if problem.time is not None else Method.RELAXATION
        return ask(method=method, device=self.device)

    def run(self, progress: Progress = in_silence) -> list[Run]:
        """Solve them, up to where equilibrium ends."""
        runs: list[Run] = []
        end = ""
        for values, problem in self.row:
            run = functools.partial(Run, values, self.simulator, self.element, self.strain)
            if end:
                runs.append(run(None, end, was_tried=False))
                continue
            place = ", ".join(f"{a.key} = {v:g}" for a, v in zip(self.axes, values, strict=True))
            kind = f"{self.element} tetrahedra, {self.strain} strain"
            progress(f"{self.simulator}, {kind}, {place}")
            try:
                found = self._solve(problem)
                # A table and figures need no stresses, which are most of a state.
                runs.append(run(dataclasses.replace(found, stresses=None)))
            except ReferenceUnavailableError:
                raise
            except (CandidateFailedError, ReferenceFailedError) as error:
                runs.append(run(None, self.units.in_case_units(str(error))))
                if self.axes[0].is_load:
                    end = f"not tried: no answer at {self.axes[0].key} = {values[0]:g}"
        return runs


def linear_error(run: Run, runs: Sequence[Run]) -> float | None:
    """How far a linear answer is from the Green one, relative L2 of displacement [-]."""
    if run.state is None:
        return None
    for other in runs:
        is_its_green = other.strain is Strain.GREEN and other.state is not None
        if is_its_green and (other.who, other.values) == (run.who, run.values):
            return difference(run.state, other.state)
    return None


def difference(one: State | None, other: State | None) -> float:
    """Relative L2 of displacement [-], of the other's."""
    assert one is not None
    assert other is not None
    scale = float(np.linalg.norm(other.displacement))
    return float(np.linalg.norm(one.displacement - other.displacement)) / (scale or 1.0)
