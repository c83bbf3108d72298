"""Solve every variant with both strains, in order of the load, up to where equilibrium ends."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

import palpate
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Problem, Strain
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.case.units import Units
from palpate.validation.case.variants import Axis, Variant
from palpate.validation.solving import Simulator, solve
from palpate.validation.states import CandidateFailedError, Method, Progress, State, in_silence

# Workers of a dask scheduler instead of this machine's threads: an optional extra.

# How long a scheduler has to answer [s].
_PATIENCE = 10.0


class SchedulerError(InputError):
    """A scheduler that is of no use; `.address` holds it as it was given."""

    def __init__(self, address: str, reason: str) -> None:
        self.address = address
        super().__init__(f"scheduler {address!r}: {reason}")


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Yield an executor whose tasks run on the workers of a dask scheduler.

    Args:
        address: Of the scheduler, as `tcp://host:8786`.

    Raises:
        SchedulerError: dask.distributed is not installed, nobody answers, there is no worker, or
            a worker has no palpate, or one of another version.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SchedulerError(
            address, 'needs dask.distributed; pip install "palpate[cluster]"'
        ) from None
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SchedulerError(address, f"no dask scheduler answers there ({error})") from error
    with client:
        _require_workers(address, client.run(_version, on_error="return"))
        with client.get_executor(pure=False) as pool:
            yield pool


def _version() -> str:
    return palpate.__version__


def _require_workers(address: str, versions: dict[str, object]) -> None:
    """Refuse workers that would not compute as this machine does."""
    if not versions:
        raise SchedulerError(address, "it has no worker; start one with `dask worker ADDRESS`")
    here = palpate.__version__
    for worker, version in versions.items():
        if version != here:
            found = f"palpate {version}" if isinstance(version, str) else f"no palpate ({version})"
            reason = f"worker {worker} has {found}, here is {here}; install the same there"
            raise SchedulerError(address, reason)


@dataclass(frozen=True, eq=False)
class Run:
    """One variant by one simulator with one element and one strain.

    Attributes:
        values: One for each axis.
        simulator: Who solved: a simulator of palpate, or the name of somebody else's.
        element: With which tetrahedra.
        strain: With which law.
        state: The result, None where there is none.
        trouble: Why there is none; "not tried: ..." beyond where equilibrium ends.
        was_tried: Whether it was solved at all.
    """

    values: tuple[float, ...]
    simulator: Simulator | str
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
    simulators: Sequence[Simulator | OutsideSimulator],
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
    chains = []
    rows = _loads_from_the_smallest(found) if axes[0].is_load else [[v] for v in found]
    for simulator, element, strain in product(simulators, elements, Strain):
        if simulator is Simulator.CONDENSED and strain is not Strain.LINEAR:
            continue  # all that it knows
        for row in rows:
            problems = [(variant.values, variant.case.problem) for variant in row]
            units = row[0].case.spec.units
            chains.append((axes, problems, units, simulator, element, strain, device))
    if scheduler is not None:
        with cluster(scheduler) as pool:
            waiting = [pool.submit(solve_row, *chain) for chain in chains]
            for count, future in enumerate(as_completed(waiting), start=1):
                last = future.result()[-1]
                line = f"{last.who}, {last.strain} strain: {count} of {len(chains)} rows done"
                progress(line)
            return [run for future in waiting for run in future.result()]
    with ThreadPoolExecutor(jobs) as pool:  # both leave Python while they solve
        waiting = [pool.submit(solve_row, *chain, progress) for chain in chains]
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


def solve_row(
    axes: Sequence[Axis],
    row: Sequence[tuple[tuple[float, ...], Problem]],
    units: Units,
    simulator: Simulator | OutsideSimulator,
    element: Element,
    strain: Strain,
    device: str = "cpu",
    progress: Progress = in_silence,
) -> list[Run]:
    """Solve variants, by values and problem, one after the other, up to where equilibrium ends.

    All of it is plain data, which another machine can have.
    """
    name = name_of(simulator) if isinstance(simulator, OutsideSimulator) else simulator
    runs: list[Run] = []
    end = ""

    def ask(problem: Problem, **how: Any) -> State:
        if isinstance(simulator, OutsideSimulator):
            return outside_candidate(simulator, element).solve(problem, strain, in_silence)
        return solve(problem, strain=strain, element=element, with_=simulator, **how)

    for values, problem in row:
        run = functools.partial(Run, values, name, element, strain)
        if end:
            runs.append(run(None, end, was_tried=False))
            continue
        where = ", ".join(f"{a.key} = {v:g}" for a, v in zip(axes, values, strict=True))
        progress(f"{name}, {element} tetrahedra, {strain} strain, {where}")
        try:
            if device == "cpu" or simulator is not Simulator.FASTSIM:
                found = ask(problem)
            else:
                method = Method.NEWTON if problem.time is not None else Method.RELAXATION
                found = ask(problem, method=method, device=device)
            # A table and figures need no stresses, which are most of a state.
            runs.append(run(dataclasses.replace(found, stresses=None)))
        except ReferenceUnavailableError:
            raise
        except (CandidateFailedError, ReferenceFailedError) as error:
            runs.append(run(None, units.in_case_units(str(error))))
            if axes[0].is_load:
                end = f"not tried: no solution at {axes[0].key} = {values[0]:g}"
    return runs


def name_of(simulator: OutsideSimulator) -> str:
    """The name of somebody else's simulator, which is no name of palpate's own."""
    return f"{simulator.name} (simulator)"


def linear_error(run: Run, runs: Sequence[Run]) -> float | None:
    """How far a linear result is from the Green one, relative L2 of displacement [-]."""
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
