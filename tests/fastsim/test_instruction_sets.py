"""Every compiled kernel gives the same motion, and can be asked for by name."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import clamped

from palpate.fastsim import _core
from palpate.fastsim.dynamics import DynamicResult, simulate
from palpate.fastsim.explicit_body import Precision
from palpate.fastsim.instruction_sets import VARIABLE, chosen_instruction_set
from palpate.meshes.boundary_conditions import BodyForce
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Material, Problem, Strain, TimeSpan

SETS = list(_core.InstructionSet)
AVAILABLE = SETS[: SETS.index(_core.widest_instruction_set()) + 1]
EPS = {Precision.SINGLE: 2.0**-23, Precision.DOUBLE: 2.0**-52}
NUM_STEPS = 200


@pytest.fixture(scope="module")
def beam() -> Problem:
    # 270 cells and 96 points: neither fills whole batches or packs.
    mesh = brick_box((5, 3, 3), (2.0, 1.0, 1.0), ragged=0.15)
    span = TimeSpan(NUM_STEPS * 2e-3, 2e-3, 3.0, 1)
    load = BodyForce((0.0, 40.0, -200.0))
    return Problem(mesh, Material(1e4, 0.3, 1000.0), (clamped(mesh),), (load,), span)


def run(
    problem: Problem, name: str, monkeypatch: pytest.MonkeyPatch, **options: object
) -> DynamicResult:
    monkeypatch.setenv(VARIABLE, name)
    return simulate(problem, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("num_threads", [1, 2])
@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("strain", list(Strain))
@pytest.mark.parametrize("name", [known.name for known in AVAILABLE[1:]])
def test_the_kernels_agree_to_rounding_over_many_steps(
    beam: Problem,
    name: str,
    strain: Strain,
    precision: Precision,
    num_threads: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    options = {"strain": strain, "precision": precision, "num_threads": num_threads}
    ours = run(beam, name, monkeypatch, **options)
    plain = run(beam, "baseline", monkeypatch, **options)
    assert (ours.instruction_set, plain.instruction_set) == (name, "baseline")
    difference = np.abs(ours.displacements[-1] - plain.displacements[-1]).max()
    size = np.abs(plain.displacements[-1]).max()
    assert size > 1e-2
    # Rounding of the increments of 200 steps, at most added up.
    assert difference < NUM_STEPS * EPS[precision] * size


@pytest.mark.parametrize("name", [known.name for known in AVAILABLE])
def test_each_kernel_repeats_bit_for_bit(
    beam: Problem, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for precision in Precision:
        one, other = (
            run(beam, name, monkeypatch, precision=precision, num_threads=2).displacements
            for _ in range(2)
        )
        assert np.array_equal(one, other)


def test_the_widest_is_the_default_and_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert chosen_instruction_set() == _core.widest_instruction_set()
    monkeypatch.setenv(VARIABLE, SETS[-1].name)
    assert chosen_instruction_set() == _core.widest_instruction_set()
    monkeypatch.setenv(VARIABLE, "baseline")
    assert chosen_instruction_set() == _core.InstructionSet.baseline


def test_a_name_that_is_no_instruction_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "sse9")
    with pytest.raises(InputError, match="baseline, avx2, avx512"):
        chosen_instruction_set()
