"""A motion that nobody waits for, or whose numbers overflow, is refused with the number, at once.

They are solved in another process, which would hang or end with an inner error.
"""

import pytest
from limits import run_limited

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError, TooManyStepsError
from palpate.meshes.problem import Material, Problem, TimeSpan

SOLVE = """
from palpate.validation.case import load_case
from palpate.fastsim.dynamics import simulate
for path in sys.argv[1:]:
    try:
        simulate(load_case(path).problem, strain=load_case(path).strain)
    except InputError as error:
        print(type(error).__name__, error, flush=True)
"""
NO_STEP = ("time_step = 5e-4\n", "")
TRUTH = ('"trajectory_l2"', '"trajectory_l2"\nagainst = "truth"')


REFUSED = [
    ([("end_time = 0.04", "end_time = 1e300")], "end_time = 1e+300 s: needs a value above 0"),
    ([("end_time = 0.04", "end_time = 1e25")], "2e+28 steps; at most 1e+09"),
    ([("5e-4", "1e-30")], "4e+28 steps"),
    ([("5e-4", "1e-310")], "steps of 1e-310 s are inf steps"),
    ([NO_STEP, TRUTH, ("end_time = 0.04", "end_time = 1e25")], "at most 1e+09"),
    ([NO_STEP, TRUTH, ("density = 1000.0", "density = 1e-25")], "at most 1e+09"),
    ([NO_STEP, TRUTH, ("2e4", "1e29")], "at most 1e+09"),
    ([NO_STEP, TRUTH, ("mass_damping = 1.0", "stiffness_damping = 1e200")], "steps; at most"),
    ([("2e4", "1e300")], "youngs_modulus = 1e+300 Pa: needs a value from 1e-30 to 1e+30"),
    ([("density = 1000.0", "density = 1e-300")], "density = 1e-300 kg/m3: needs a value"),
    ([NO_STEP, TRUTH, ("2e4", "1e300")], "youngs_modulus = 1e+300"),
]


def test_a_motion_that_does_not_end_is_refused_with_the_number(let_go):
    paths = []
    for number, (changes, _) in enumerate(REFUSED):
        text = let_go.read_text("utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        paths.append(let_go.with_name(f"case-{number}.toml"))
        paths[-1].write_text(text, "utf-8")
    done = run_limited(SOLVE, *paths, seconds=60)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, f"{lines}\n{done.stderr[-3000:]}"
    assert len(lines) == len(REFUSED)
    for (changes, words), line in zip(REFUSED, lines, strict=True):
        assert words in line, changes


def test_the_number_of_steps_stands_in_the_error():
    with pytest.raises(TooManyStepsError) as refused:
        TimeSpan(1.0, 1e-10)
    assert refused.value.num_steps == pytest.approx(1e10)
    assert refused.value.time_step == 1e-10
    assert TimeSpan(1.0, 1e-9).time_step == 1e-9  # a thousand million are taken


def test_states_that_fill_the_memory_are_refused_before_they_are_made():
    mesh = brick_box((20, 20, 20), (1.0, 1.0, 1.0))
    with pytest.raises(InputError, match=r"num_outputs = 100000: states of 9261 points take 22\.2"):
        Problem(mesh, Material(1.0, 0.3), (), (), TimeSpan(1.0, num_outputs=100_000))
