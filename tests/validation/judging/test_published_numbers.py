"""Force, volume, energy and stress beside closed forms: a block pressed between smooth walls.

Sides held along their normals leave one stretch a: with M = lmbda + 2 mu and e = (a^2 - 1) / 2 by
Green's strain (a - 1 by engineering strain), S_xx = M e and S_yy = lmbda e; P_xx = a S_xx is also
Cauchy's sigma_xx, and sigma_yy = S_yy / a; the energy is M e^2 / 2 for each rest volume. By
engineering strain all stresses are S.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from judged import GREEN, solved, state_of
from pydantic import ValidationError

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.validation.candidates.candidate import fastsim_candidate
from palpate.validation.candidates.faults import on_own_mesh
from palpate.validation.case import Case, load_case
from palpate.validation.case.schema import CheckSpec
from palpate.validation.case.units import Units
from palpate.validation.judging.checks import (
    CaseJudge,
    compare_published,
    name_of_bar,
    number_of,
)
from palpate.validation.judging.precision import PrecisionGrant
from palpate.validation.judging.results import CheckResult
from palpate.validation.metrics import stress_integrals
from palpate.validation.references.reference_set import QUADRATIC, SAME_MESH, TRUTH, ReferenceSet
from palpate.validation.references.stored import read_reference, write_reference
from palpate.validation.states import (
    CellStresses,
    Precision,
    State,
    Trajectory,
    Verdict,
    in_silence,
)

# 2 x 1 x 1 cm of 10 kPa; forces in mN, so that energies are in mN cm, 1e-5 J.
A, E, NU = 0.9, 10.0, 0.3
LMBDA, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
M = LMBDA + 2 * MU
# 1 kPa on 1 cm2 is 100 mN.
AREA = 100.0
WALL = "[[support]]\nregion = {{ half_space = {{ point = {}, normal = {} }} }}\nsliding = true\n"
WALLS = "".join(
    WALL.format(point, normal)
    for point, normal in (
        ([0.001, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ([0.0, 0.001, 0.0], [0.0, -1.0, 0.0]),
        ([0.0, 0.999, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 0.0, 0.001], [0.0, 0.0, -1.0]),
        ([0.0, 0.0, 0.999], [0.0, 0.0, 1.0]),
    )
)
PUSHED = "[[support]]\nregion = { half_space = { point = [1.999, 0, 0], normal = [1, 0, 0] } }\n"
PUSHED += 'components = ["x"]\ndisplacement = [-0.2, 0.0, 0.0]\n'
# The plane's solid side is its z < 0, turned to face -x.
TURNED = "rotation = { axis = [0, 1, 0], angle_deg = -90.0 }"
PLATE = f"""[tool]
shape = "plane"
pose = [
  {{ time = 0.0, position = [2.0, 0.0, 0.0], {TURNED} }},
  {{ time = 1.0, position = [1.8, 0.0, 0.0], {TURNED} }},
]
"""
CASE = """
schema = 1
title = "A block pressed between smooth walls"
strain = "green"

[units]
length = "cm"
stress = "kPa"
force = "mN"

[geometry]
shape = "box"
size = [2.0, 1.0, 1.0]
edge_length = 1.0

[material]
youngs_modulus = 10.0
poissons_ratio = 0.3

"""
EVERYWHERE = "region = { half_space = { point = [0, 0, 0], normal = [1, 0, 0] } }"


Form = tuple[str, str, float]
# A corner of the pressed face goes as far as it is pushed.
CORNER: Form = ("published_displacement", 'at = [2.0, 1.0, 1.0]\ncomponent = "x"', 2.0 * (A - 1))


def forms(strain: Strain) -> list[Form]:
    """Metric, what it is of, and the number in the case's units."""
    is_green = strain is GREEN
    e = (A**2 - 1) / 2 if is_green else A - 1
    pressed = A * M * e if is_green else M * e
    aside = LMBDA * e / A if is_green else LMBDA * e
    von_mises = abs(pressed - aside)
    return [
        ("published_reaction", 'support = 1\ncomponent = "x"', -pressed * AREA),
        # Along y on 2 cm2: P_yy = S_yy.
        ("published_reaction", 'support = 2\ncomponent = "y"', -LMBDA * e * 2 * AREA),
        ("published_volume_change", "", 2.0 * (A - 1)),
        ("published_energy", "", 0.5 * M * e**2 * 2.0 * AREA),
        ("published_stress", f'component = "xx"\n{EVERYWHERE}', pressed),
        ("published_stress", f'component = "yy"\n{EVERYWHERE}', aside),
        ("published_stress", f'component = "largest_principal"\n{EVERYWHERE}', aside),
        ("published_stress", f'component = "von_mises"\n{EVERYWHERE}', von_mises),
    ]


def check(metric: str, of: str, expected: float, strain: Strain, **more: object) -> str:
    keys = {"against": '"candidate"', "limit": 1e-6, "uncertainty": 0.0} | more
    lines = [f"{key} = {value}" for key, value in keys.items()]
    return "\n".join(
        [
            f'\n[[check]]\nmetric = "{metric}"\nstrain = "{strain}"\nexpected = {expected!r}',
            'reason = "closed form"',
            of,
            *lines,
            "",
        ]
    )


def write(folder: Path, *checks: str, by: str = PUSHED) -> Case:
    path = folder / "pressed.toml"
    path.write_text(CASE + WALLS + by + "".join(checks), encoding="utf-8")
    return load_case(path)


def as_truth(case: Case, state: State, label: str) -> State:
    """A homogeneous state as a quadratic one would be stored."""
    stresses = state.stresses
    assert stresses is not None
    F = np.diag([A, 1.0, 1.0]) if state.strain is GREEN else np.eye(3)
    P = F @ stresses.second_piola_kirchhoff
    reported = CellStresses(stresses.second_piola_kirchhoff, stresses.cauchy, P)
    spec = case.checks[0].model_copy(update={"metric": "published_energy", "component": None})
    energy = number_of(spec, case.problem, state, case.spec.units)
    assert energy is not None
    integrals = stress_integrals(case.problem.mesh, reported, energy.value)
    assert integrals is not None
    return dataclasses.replace(
        state, label=label, simulator="reference", degree=2, integrals=integrals, stresses=None
    )


def judged(
    case: Case, candidate: State | None, *truths: State, bar: float | None = None
) -> list[CheckResult]:
    """With a bar of everything that is asked of the stored truth, where one is given."""
    states = {(state.label, state.strain): state for state in truths}
    bars = {("volume", s): 1e-9 for s in Strain}
    if bar is not None:
        names = [name_of_bar(spec, case.problem, case.spec.units) for spec in case.checks]
        bars |= {(name, s): bar for name in names if name != "volume" for s in Strain}
    judge = CaseJudge(case, ReferenceSet(states, bars, "made"))
    return [judge.check(spec, candidate) for spec in judge.checks]


@pytest.mark.parametrize("element", Element)
@pytest.mark.parametrize("strain", Strain)
def test_the_closed_forms_of_the_candidate(tmp_path: Path, strain: Strain, element: Element):
    case = write(tmp_path, *(check(*form, strain) for form in forms(strain)))
    solution = solved(case.problem, strain, element=element)
    for found in judged(case, solution):
        assert found.verdict is Verdict.PASSED, found.message
        assert found.value is not None
        assert found.value < 1e-9
    # 2 % farther pressed, the other strain's numbers, nothing at all: all red.
    perturbed = dataclasses.replace(
        solution,
        displacement=1.02 * solution.displacement,
        volume=case.problem.mesh.volume * (1 + 1.02 * (A - 1)),
        stresses=None,
    )
    still = dataclasses.replace(
        solution, displacement=0 * solution.displacement, volume=2e-6, stresses=None
    )
    for wrong in (perturbed, still):
        assert {found.verdict for found in judged(case, wrong)} == {Verdict.FAILED}
    (other,) = (s for s in Strain if s is not strain)
    case = write(tmp_path, *(check(*form, strain) for form in forms(other)))
    verdicts = [found.verdict for found in judged(case, solution)]
    # The volume is that of a prescribed length in both.
    assert [verdict is Verdict.PASSED for verdict in verdicts] == [
        form[0] == "published_volume_change" for form in forms(other)
    ]


@pytest.mark.parametrize("strain", Strain)
def test_the_truths_numbers_have_the_bars_that_it_was_asked_for(tmp_path: Path, strain: Strain):
    checks = [check(*form, strain, against='"truth"') for form in forms(strain)]
    case = write(tmp_path, *checks)
    solution = solved(case.problem, strain)
    truth, coarse = as_truth(case, solution, TRUTH), as_truth(case, solution, QUADRATIC)
    for found in judged(case, None, truth, bar=1e-8):
        assert found.verdict is Verdict.PASSED, found.message
        assert 0.0 < found.reference_error < 1e-6
    # Of the force, energy or norm of the stress: what can be off is at least that of the number.
    for found in judged(case, None, truth, bar=3e-6):
        if found.metric != "published_volume_change":
            assert found.verdict is Verdict.INCONCLUSIVE
            assert 2.9e-6 < found.reference_error < 2e-5
    # Built for other parts of the body: nothing is told, and said how to get it.
    for found in judged(case, None, truth):
        if found.metric != "published_volume_change":
            assert found.verdict is Verdict.INCONCLUSIVE
            assert "build it anew" in found.message
    # One on the case's mesh is told from linear tetrahedra there; alone, by nothing.
    linear = dataclasses.replace(solution, label=SAME_MESH)
    assert {f.verdict for f in judged(case, None, coarse, linear)} == {Verdict.PASSED}
    found = [f.verdict for f in judged(case, None, coarse) if f.metric != "published_volume_change"]
    assert set(found) == {Verdict.INCONCLUSIVE}
    # Stored without stresses or energy: likewise.
    assert truth.integrals is not None
    old = dataclasses.replace(truth.integrals, strain_energy=None)
    messages = [
        f.message for f in judged(case, None, dataclasses.replace(truth, integrals=old), bar=1e-8)
    ]
    assert "not asked for stresses and energy" in messages[3]
    mute = dataclasses.replace(truth, integrals=None)
    for found in judged(case, None, mute, bar=1e-8):
        if found.metric != "published_volume_change":
            assert found.verdict is Verdict.INCONCLUSIVE


def test_a_files_truth_shows_the_energy(tmp_path: Path):
    case = write(tmp_path, check(*forms(GREEN)[3], GREEN))
    truth = as_truth(case, solved(case.problem), TRUTH)
    given = ReferenceSet({(TRUTH, GREEN): truth}, {}, "made")
    write_reference(tmp_path / "x.npz", "pressed", "key", given, {})
    again = read_reference(tmp_path / "x.npz")[0].states[TRUTH, GREEN].integrals
    assert again is not None
    assert truth.integrals is not None
    assert again.strain_energy == truth.integrals.strain_energy


@pytest.mark.parametrize("strain", Strain)
def test_the_force_of_a_plate(tmp_path: Path, strain: Strain):
    pressed = forms(strain)[0][2]
    reported = check("published_tool_force", 'tool = 1\ncomponent = "x"', pressed, strain)
    case = write(tmp_path, reported, by=PLATE)
    solution = solved(case.problem, strain)
    (found,) = judged(case, solution)
    # What the plate feels is what it exerts, turned round: along +x.
    assert found.verdict is Verdict.PASSED, found.message
    assert "mN" in found.message
    assert solution.tool_forces is not None
    for forces in (1.02 * solution.tool_forces, 0 * solution.tool_forces, None):
        (found,) = judged(case, dataclasses.replace(solution, tool_forces=forces))
        assert found.verdict is Verdict.FAILED


@pytest.mark.parametrize("against", ["candidate", "truth"])
@pytest.mark.parametrize("form", [*forms(GREEN), CORNER], ids=lambda form: form[0])
def test_a_measurements_uncertainty_counts_like_a_bar(tmp_path: Path, form: Form, against: str):
    metric, of, exact = form
    for off, uncertainty, wanted in (
        (0.01, 0.0, Verdict.PASSED),
        (0.01, 0.005, Verdict.PASSED),
        (0.01, 0.015, Verdict.INCONCLUSIVE),
        (0.03, 0.0, Verdict.FAILED),
        (0.03, 0.005, Verdict.FAILED),
        (0.03, 0.015, Verdict.INCONCLUSIVE),
    ):
        measured = exact / (1.0 - off)
        more = {"uncertainty": uncertainty * abs(measured), "limit": 0.02}
        case = write(tmp_path, check(metric, of, measured, GREEN, against=f'"{against}"', **more))
        solution = solved(case.problem)
        if against == "candidate":
            (found,) = judged(case, solution)
        else:
            truth = as_truth(case, solution, TRUTH)
            (found,) = judged(case, None, truth, bar=1e-12)
            if form is CORNER:  # the truth's own bar comes on top
                (doubtful,) = judged(case, None, truth, bar=0.04)
                assert doubtful.verdict is Verdict.INCONCLUSIVE
        assert found.verdict is wanted
        assert found.value == pytest.approx(off, rel=1e-6)
        assert found.reference_error == pytest.approx(uncertainty, abs=1e-6)
        assert ("+-" in found.message) == bool(found.reference_error)


def test_single_precision_is_granted_to_them_too(tmp_path: Path):
    reported = [check(*form, GREEN, limit=1e-12) for form in forms(GREEN)]
    case = write(tmp_path, *reported)
    right = dataclasses.replace(solved(case.problem), label=SAME_MESH)
    given = ReferenceSet({(SAME_MESH, GREEN): right}, {}, "made")
    for spec in PrecisionGrant(case, given, Precision.SINGLE).checks():
        assert 1e-8 < spec.limit < 1e-4, spec.metric


@pytest.mark.parametrize(
    ("metric", "lines", "words"),
    [
        ("published_reaction", {"component": "x"}, "needs support"),
        ("published_reaction", {"support": 1}, "needs component"),
        ("published_reaction", {"support": 1, "component": "xx"}, "is one of x, y, z"),
        ("published_reaction", {"support": 1, "component": "x", "tool": 1}, "tool goes with"),
        ("published_tool_force", {"component": "x"}, "needs tool"),
        ("published_tool_force", {"tool": 0, "component": "x"}, "greater than or equal to 1"),
        ("published_volume_change", {"component": "x"}, "component goes with"),
        ("published_volume_change", {"at": (0, 0, 0)}, "at goes with published_displacement"),
        ("published_volume_change", {"expected": 0.0}, "no scale"),
        ("published_energy", {"expected": None}, "needs expected"),
        ("published_energy", {"uncertainty": -1.0}, "greater than or equal to 0"),
        ("published_energy", {"against": "same_mesh"}, 'goes with against = "candidate"'),
        ("published_energy", {"support": 1}, "support goes with traction_resultant, published_re"),
        ("published_stress", {"component": "xx"}, "needs region"),
        ("published_stress", {"component": "zx"}, "component"),
        ("published_displacement", {"component": "xx", "at": (0, 0, 0)}, "is one of x, y, z"),
        ("displacement_l2", {"against": "same_mesh"}, "expected goes with"),
        (
            "displacement_l2",
            {"against": "same_mesh", "expected": None, "uncertainty": 0.1},
            "uncertainty goes with published_displacement, pub",
        ),
    ],
)
def test_bad_checks_are_named(metric: str, lines: dict[str, object], words: str):
    reported = {
        "metric": metric,
        "against": "candidate",
        "limit": 0.1,
        "reason": "r",
        "expected": 1.0,
    }
    with pytest.raises(ValidationError) as caught:
        CheckSpec.model_validate(reported | lines)
    assert words in str(caught.value)


def test_what_is_not_there_is_named(tmp_path: Path):
    of = 'support = 9\ncomponent = "x"'
    with pytest.raises(InputError, match=r"support = 9, but the case has 6"):
        write(tmp_path, check("published_reaction", of, 1.0, GREEN)).problem  # noqa: B018
    of = 'tool = 2\ncomponent = "x"'
    with pytest.raises(InputError, match=r"tool = 2, but the case has 1"):
        write(tmp_path, check("published_tool_force", of, 1.0, GREEN), by=PLATE).problem  # noqa: B018
    of = 'tool = 1\ncomponent = "x"'
    with pytest.raises(InputError, match=r"published_tool_force needs \[tool\]"):
        write(tmp_path, check("published_tool_force", of, 1.0, GREEN))
    time = "[time]\nend_time = 0.1\nnum_outputs = 2\n"
    moving = PUSHED + "amplitude = { times = [0.0, 0.1], factors = [0.0, 1.0] }\n" + time
    of = 'support = 6\ncomponent = "x"'
    with pytest.raises(InputError, match="support 6 moves in time"):
        write(tmp_path, check("published_reaction", of, 1.0, GREEN), by=moving).problem  # noqa: B018
    with pytest.raises(InputError, match=r"the truth of a case with \[time\] knows"):
        write(tmp_path, check(*forms(GREEN)[3], GREEN, against='"truth"'), by=PUSHED + time)


def test_a_solution_on_a_mesh_of_its_own_is_read_with_its_doubt(tmp_path: Path):
    case = write(tmp_path, *(check(*form, GREEN, limit=0.05) for form in forms(GREEN)))
    solution = on_own_mesh(fastsim_candidate()).solve(case.problem, GREEN, in_silence)
    assert solution.own is not None
    for found in judged(case, solution):
        # Homogeneous: nothing is lost between the points of either mesh.
        assert found.verdict is Verdict.PASSED, found.message
        assert found.value is not None
        assert found.value < 1e-6
    twice = dataclasses.replace(
        solution,
        own=dataclasses.replace(solution.own, displacements=2.0 * solution.own.displacements),
        volume=case.problem.mesh.volume * (1 + 2.0 * (A - 1)),
    )
    assert Verdict.PASSED not in {found.verdict for found in judged(case, twice)}


def test_of_a_motion_it_is_the_last_state(tmp_path: Path):
    of = [form for form in forms(GREEN) if form[0] != "published_tool_force"]
    still = write(tmp_path, *(check(*form, GREEN) for form in of))
    last = solved(still.problem)
    time = "[time]\nend_time = 0.1\nnum_outputs = 4\n"
    case = write(tmp_path, *(check(*form, GREEN) for form in of), by=PUSHED + time)
    assert case.problem.time is not None
    times = np.linspace(0.0, 0.1, 5)
    motion = Trajectory(times, times[:, None, None] / 0.1 * last.displacement)
    moved = dataclasses.replace(last, trajectory=motion, stresses=None)
    assert {found.verdict for found in judged(case, moved)} == {Verdict.PASSED}
    early = dataclasses.replace(
        moved, displacement=0.75 * last.displacement, volume=case.problem.mesh.volume * 0.925
    )
    assert {found.verdict for found in judged(case, early)} == {Verdict.FAILED}


@pytest.mark.parametrize("other", [0.012, 0.008])
def test_a_displacement_read_between_outputs_is_as_doubtful_as_two_readings_are_apart(
    other: float,
) -> None:
    """1 cm in the one reading and 2 mm farther or nearer in the other, of 1 cm expected."""
    case = load_case("block")
    number = CheckSpec(
        metric="published_displacement", against="candidate", at=(40.0, 0.0, 0.0), component="x",
        expected=10.0, limit=0.5, reason="r",
    )  # fmt: skip
    moved = np.zeros_like(case.problem.mesh.points)
    moved[:, 0] = 0.010
    state = state_of(case.problem, moved)
    again = dataclasses.replace(state, displacement=other / 0.010 * moved)
    found = compare_published(
        number,
        case.problem,
        dataclasses.replace(state, other_reading=again),
        Units(length="mm", stress="kPa"),
    )
    assert found.error == pytest.approx(0.0, abs=1e-12)
    assert found.uncertainty == pytest.approx(0.2)
