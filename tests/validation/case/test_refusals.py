"""What is wrong with a case is named by file, line and key, with what was meant or what to do."""

import re

import pytest
from case_texts import (
    BOX,
    CHECK,
    CLAMP,
    FORCE,
    LIQUID,
    LOAD,
    MILLIMETRES,
    MODULI,
    MOMENT,
    OGDEN,
    PARABOLA,
    RIVLIN,
    ROOT,
    SPRING,
    VALUES,
    moving,
)

from palpate.meshes.errors import InputError
from palpate.validation.case import CaseError, load_case

PULLED = "region = { half_space = { point = [1.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }"
SPHERE = 'shape = "sphere"\nradius = 1.0'
MOVED = '[tool]\nshape = "sphere"\nradius = 1.0\n'
PART = "region = { box = { min = [0.6, -1.0, -1.0], max = [1.6, 2.0, 2.0] } }"
AWAY = PART.replace("0.6", "7.6").replace("1.6", "8.6")
ALL = PART.replace("0.6", "-9").replace("1.6", "9")
TURN = "rotation = { axis = [0, 0, 1], center = [0, 0, 0], angle_deg = 3 }"
SAME_STEPS = '[[check]]\nmetric = "trajectory_l2"\nlimit = 1e-9\nreason = "the same steps"\n\n'
OF_TRUTH = '[[check]]\nmetric = "{}"\nagainst = "truth"\nlimit = 0.1\nreason = "r"\n\n[[tool]]'


def before(table, text):
    return table, f"{text}\n{table}"


def support(how):
    return CLAMP, f"[[support]]\n{ROOT}{how}"


def load(text):
    return FORCE, text


def material(text):
    return MODULI, text


def spring(old, new):
    assert old in SPRING
    return LOAD, SPRING.replace(old, new)


def check(metric, *lines):
    text = "\n".join([f'metric = "{metric}"', "limit = 0.1", 'reason = "r"', *lines])
    return CHECK, f"\n[[check]]\n{text}\n{CHECK}"


# What was written instead of what, and the key or word that was meant.
MEANT = [
    ("title =", "titel =", "title"),
    ('"displacement_l2"', '"displacment_l2"', "displacement_l2"),
    ('"displacement_l2"', '"Displacement_L2"', "displacement_l2"),
    ("limit = 1e-8", 'limit = 1e-8\nagainst = "samemesh"', "same_mesh"),
    ("limit = 1e-8", 'limit = 1e-8\nagainst = "thruth"', "truth"),
    ("limit = 1e-8", "tolerance = 1e-8", "limit"),
    ('reason = "same equations"', 'reson = "same equations"', "reason"),
    ('kind = "force"', 'kind = "froce"', "force"),
    (FORCE + "\n" + PULLED, 'kind = "gravity"\naccelaration = [0.0, 0.0, -9.8]', "acceleration"),
    (FORCE + "\n" + PULLED, 'kind = "gravity"\ng = [0.0, 0.0, -9.8]', "acceleration"),
    (FORCE, 'kind = "pressure"\npresure = 3.0\n', "pressure"),
    (FORCE, 'kind = "traction"\ntracton = [1.0, 0.0, 0.0]\n', "traction"),
    (FORCE, FORCE + "\namplitud = { times = [0], factors = [1] }", "amplitude"),
    ('shape = "box"', 'shape = "bxo"', "box"),
    ("[[support]]", '[[support]]\ncomponents = ["X"]', "x"),
    ("half_space = { point = [0.001", "halfspace = { point = [0.001", "half_space"),
    ("[geometry]", '[units]\nlength = "MM"\n[geometry]', "mm"),
    ("[geometry]", '[units]\nlenght = "mm"\n[geometry]', "length"),
    ("title =", 'strain = "grene"\ntitle =', "green"),
    ("[material]", "[mesh]\nsize = 0.5\n[material]", "edge_length"),
    ("[material]", '[mesh]\nmesher = "gmesh"\n[material]', "gmsh"),
    ("edge_length = 0.5", "h = 0.5", "edge_length"),
    ("edge_length = 0.5", "element_size = 0.5", "edge_length"),
    ("youngs_modulus = 1000.0", "E = 1000.0", "youngs_modulus"),
    ("poissons_ratio = 0.3", "nu = 0.3", "poissons_ratio"),
    ("poissons_ratio = 0.3", "poisons_ratio = 0.3", "poissons_ratio"),
    ("poissons_ratio = 0.3", "poissons_ratio = 0.3\nrho = 900", "density"),
    ("[[support]]", "[time]\nend_time = 1\ndt = 0.1\n[[support]]", "time_step"),
    ("[[support]]", f"{MOVED}pose = [{{time = 0, positon = [0]}}]\n[[support]]", "position"),
    (*material(MODULI + 'law = "neo-hokean"\n'), "neo-hookean"),
    (*load(PARABOLA.replace("parabolic", "parabolik")), "parabolic"),
    (*load(VALUES.replace("traction = [4", "tracton = [4")), "traction"),
]  # fmt: skip
# What the schema refuses, and what is said of it.
SCHEMA = [
    (("poissons_ratio = 0.3", "poisons_ratio = 0.3"), "block.toml:12: unknown key 'material"),
    (("poissons_ratio = 0.3", ""), "missing key 'material.poissons_ratio'"),
    (("edge_length = 0.5", ""), "edge_length"),
    (('shape = "box"', 'surface = "../x.stl"\nshape = "box"'), "exactly one"),
    (("limit = 1e-8", "limit = -1.0"), "limit"),
    (('reason = "same equations"', 'reason = ""'), "reason"),
    (("schema = 1", "schema = 2"), "schema"),
    (("schema = 1", "schema = [1"), "not TOML"),
    (('shape = "box"', 'shape = "zzz"'), "use box, beam, cylinder, sphere, kidney"),
    (('kind = "force"\n', ""), "'load.1.kind'; add it: force, traction"),
    # The size of cells is another key.
    ((BOX, SPHERE + "\nsize = 0.1"), "cells are sized by edge_length"),
    ((BOX, SPHERE + "\nsize = [0.1, 0.1, 0.1]"), "cells are sized by edge_length"),
    ((BOX, 'shape = "kidney"\nsize = [0.1, 0.1, 0.1]'), "cells are sized by edge_length"),
    ((BOX, 'surface = "liver.stl"\nsize = [0.1, 0.1, 0.1]'), "cells are sized by edge_length"),
    ((BOX, 'surface = "torn.off"\nlargest_hole = 20'), "takes no largest_hole"),
    ((BOX, 'surface = "torn.off"\nrepair_limit = 5.0'), "takes no repair_limit"),
    ((BOX, BOX + "\nrepair = true"), "takes no repair"),
    # A mesh file is graded, and no more.
    ((BOX, 'mesh = "liver.vtu"\n\n[mesh]\nboundary = "free"\nboundary_distance = 0.1'),
     "block.toml:9: mesh.boundary: a mesh file is graded, not meshed; remove this key, or give"),
    (before("[material]", "[[mesh.grade]]\nsmallest = 0.1"), "exactly one of point"),
    (before("[material]", "[[mesh.grade]]\nsmallest = 0.1\npoint = [0, 0, 0]\nboundary = true"),
     "exactly one of point"),
    # Truth values, text and counts are distinguished.
    (("schema = 1", "schema = true"), "schema"),
    (("schema = 1", 'schema = "1"'), "schema"),
    ((BOX, BOX + "\nrepair = 1"), "repair"),
    (before("[[support]]", "[mesh]\ngrade = [{smallest = 1.0, boundary = 1}]"), "grade"),
    (before("[[support]]", "[time]\nend_time = true"), "end_time"),
    (before("[[support]]", "[time]\nend_time = 1\nnum_outputs = 2.0"), "num_outputs"),
    (before("[[support]]", "[time]\nend_time = 1\nnum_outputs = true"), "num_outputs"),
    (before("[[support]]", "[time]\nend_time = 1\nnum_outputs = 99999999"), "num_outputs"),
    (support("amplitude = {times = [true], factors = [1]}"), "times"),
    (support('amplitude = {times = [0], factors = ["1"]}'), "factors"),
    (support("displacement = [0, false, 0]"), "displacement"),
    # Only what a results file can hold is published.
    (before("[geometry]", "[published]\nwhen = 2020-01-01"), "published.when"),
    (before("[geometry]", "[published]\nwhen = 12:30:00"), "published.when"),
    (before("[geometry]", "[published]\nwhen = 2020-01-01T12:30:00Z"), "published.when"),
    (before("[geometry]", "[published]\nvolume = nan"), "published.volume"),
    (before("[geometry]", "[published]\ndeep.rows = [[1, 2], [3, inf]]"), "deep.rows.2.2"),
    (before("[geometry]", "[published]\nhuge = 1" + "0" * 400), "published.huge"),
    # Materials.
    (material(MODULI + 'law = "mooney-rivlin"\n'), "missing key 'material.c10'"),
    (material('law = "neo-hookean"\nyoungs_modulus = 1.0\n'), "missing key 'material.poissons_r"),
    (material(MODULI + "c01 = 1.0\n"), "takes youngs_modulus, poissons_ratio, not c01"),
    (material(RIVLIN + "youngs_modulus = 1.0\n"), "not youngs_modulus"),
    (material(MODULI + 'law = "ogden"\n'), "missing key 'material.mu_1'"),
    (material(MODULI + 'law = "corotational"\nmu_1 = 1.0\n'), "not mu_1"),
    (material(OGDEN + "alpha_2 = 3.0\n"), "missing key 'material.mu_2'"),
    # Supports and motion.
    (support("sliding = true\nnormal = [1, 0, 0]"), "sliding and normal do not go together"),
    (support("sliding = true\ncomponents = ['x']"), "components and sliding do not go together"),
    (support("normal = [0, 0, 0]"), "is no direction"),
    (support(TURN.replace("1]", "0]")), "turns nothing"),
    (support("components = ['x']\n" + TURN), "components and rotation do not go together"),
    (support(TURN.replace("center = [0, 0, 0], ", "")), "center"),
    (support(TURN.replace("_deg", "")), "angle_deg"),
    (before("[[load]]", "[initial_velocity]\nvelocity = [0.0, 0.0, 1.0]\n"),
     "initial_velocity is of a motion: give [time]"),
    # Loads and springs.
    (load(LIQUID.replace("density = 1000.0\n", "")), "needs density, gravity and free_surface"),
    (load(LIQUID + "\nstart = [0, 0, 0]"), "goes without traction, values, start and end"),
    (load(LIQUID + "\ntraction = [0, 0, 0]"), "goes without traction"),
    (load(LIQUID.replace("hydrostatic", "linear")), 'goes with profile = "hydrostatic"'),
    (load(LIQUID.replace("1000.0", "-1000.0")), "greater than 0"),
    (load(LIQUID.replace("-10.0", "0.0")), "presses nothing"),
    (load('kind = "traction"'), "needs traction, alone or with a profile, or values"),
    (load(VALUES + "\ntraction = [1, 0, 0]"), "needs traction, alone or with a profile, or values"),
    (load(VALUES + "\nstart = [1, 0, 0]"), "values go without start"),
    (load(PARABOLA.replace("end = [2, 0, 1]", "")), "profile, start and end go together"),
    (load(PARABOLA.replace("end = [2, 0, 1]", "end = [2, 0, 0]")), "are the same position"),
    (load(VALUES.replace("[4, 0, 0]", "[4, 0, nan]")), "finite"),
    (load(MOMENT.replace("[0.0, 5.0, 0.0]", "5.0")), "moment"),
    (spring("stiffness = 80.0", "stiffness = 0.0"), "spring.1.stiffness"),
    (spring("radius = 0.6", "radius = -1"), "spring.1.radius"),
    (spring("displacement = [0.1, 0.0, 0.3]", ""), "needs displacement or path"),
    (spring("radius = 0.6", "radius = 0.6\nsmooth = true"), "smooth goes with path"),
    (spring("radius = 0.6", "radius = 0.6\nregion = 1"), "region"),
    # Checks.
    (check("stress_l2"), "stress_l2 needs region"),
    (check("stress_l2", "support = 1"), "support goes with traction_resultant"),
    (check("stress_l2", "region = { nearest = [1.0, 0.0, 0.0] }"), "not a point"),
    (check("stress_l2", 'against = "candidate"', PART), "candidate"),
    (check("traction_resultant"), "needs support, the number of one, or region"),
    (check("traction_resultant", "support = 1", PART), "needs support, the number of one, or reg"),
    (check("traction_resultant", "support = 0"), "greater than or equal to 1"),
    (check("traction_resultant", "support = 1.5"), "support"),
    (check("displacement_l2", PART), "region goes with stress_l2, traction_resultant"),
    (check("displacement_l2", "support = 1"), "support goes with traction_resultant"),
]  # fmt: skip
# What the mesh or the problem shows to be wrong.
BUILT = [
    (material(MODULI.replace("0.3", "0.5")), "poissons_ratio = 0.5"),
    (material(MODULI.replace("1000.0", "-3.0")), "youngs_modulus = -3"),
    (material(MODULI + "density = -1.0\n"), "density = -1"),
    (material(OGDEN.replace("mu_1 = 2.0", "mu_1 = -2.0")),
     "half the sum of mu_p alpha_p, must be above 0"),
    (material(OGDEN.replace("alpha_1 = 1.5", "alpha_1 = 80.0")), "at most 50 in size"),
    (material(RIVLIN.replace("c10 = 1.0", "c10 = -0.5")), "must be above 0, or the body has no"),
    (material(RIVLIN.replace("= 10.0", "= -1.0")), "bulk_modulus = -1 Pa"),
    (("[1.999, 0.0, 0.0]", "[7.0, 0.0, 0.0]"), "load 1: the region selects no boundary facet; the "
     "body reaches from [0.0, 0.0, 0.0] to [2.0, 1.0, 1.0]"),
    ((CLAMP, ""), "6 of 6 rigid motions"),
    (support("components = ['x']"), "3 of 6 rigid motions"),
    (support("normal = [0.0, 3.0, 4.0]"), "rigid motions are free"),
    (load(LIQUID.replace("[7.0, 7.0, 1.5]", "[0.0, 0.0, 0.75]")),
     "reaches 0.25 m above the free surface"),
    (load(VALUES.replace("[2, 1, 0]", "[2, 0, 0.5]")), "not those of one affine field"),
    # Sizes that nobody can compute with.
    (load(VALUES.replace("8]", "1e200]")), "load 1: 1e+200 Pa is too large to compute with; low"),
    (("force = [60.0,", "force = [1e308,"), "load 1: 1e+308 Pa is too large to compute with"),
    (before("[[load]]", "[[load]]\nkind = 'gravity'\nacceleration = [0, 0, -1e308]"),
     "load 1: inf N/m3 is too large to compute with"),
    (support("displacement = [1e200, 0, 0]"), "support 1: 1e+200 m is too large to compute with"),
    (support("displacement = [1, 0, 0]\namplitude = {times = [0], factors = [1e200]}"),
     "support 1: 1e+200 m is too large to compute with"),
    (spring("stiffness = 80.0", "stiffness = 1e300"), "spring 1: 1e+300 N/m is too large"),
    (spring("[1.5, 0.5, 1.0]", "[1.5, 0.5, 9.0]"), "8 m away"),
    (spring("center = [1.5, 0.5, 1.0]\nradius = 0.6", "center = [1.3, 0.3, 1]\nradius = 0.01"),
     "larger radius"),
    (spring("stiffness = 80.0", "stiffness = 80.0\namplitude = { times = [0], factors = [3] }"),
     "between 0 and 1"),
    # Cells without end.
    ((BOX, BOX.replace("0.5", "1e-3")), "asks for some"),
    ((BOX, BOX.replace("2.0", "1e308")), "asks for some"),
    ((BOX, BOX.replace("0.5", "1e-320")), "asks for some"),
    ((BOX, 'shape = "beam"\nlength = 1e9\nwidth = 1e9\nheight = 1e-9\nedge_length = 1.0'),
     "asks for some"),
    ((BOX, SPHERE + "\nedge_length = 1e-9"), "asks for some"),
    ((BOX, 'shape = "cylinder"\nradius = 1.0\nheight = 1e9\nedge_length = 0.01'), "asks for some"),
    ((BOX, 'shape = "kidney"\nedge_length = 1e-9'), "asks for some"),
    ((BOX, BOX + "\n[mesh]\nedge_length = 1e-6"), "asks for some"),
    # Parts of the body that checks look at.
    (check("traction_resultant", "support = 2"), "the case has 1 [[support]]"),
    (check("stress_l2", AWAY), "selects no cell"),
    (check("traction_resultant", AWAY), "selects no point"),
    (check("traction_resultant", ALL), "nothing is cut"),
    (check("stress_l2", 'region = { group = "apex" }'), "no facet group 'apex'"),
]  # fmt: skip
MOVING = [
    (("radius = 100.0", "radius = 0.0"), ["tool.1.radius", "greater than 0"]),
    (("radius = 100.0", "radios = 100.0"), ["radios", "'radius'"]),
    (("half_length = 250.0", ""), ["needs half_length"]),
    (("half_length", "half_widths = [1, 1, 1]\nhalf_length"), ["takes no half_widths"]),
    (("time = 0.5\npos", "time = -0.5\npos"), ["backwards at knot 1"]),
    (("position = [1000.0, 500.0, 1101.0]", "position = [nan, 0, 0]"), ["finite"]),
    (("[0.0, 2.0, 0.0]", "[0.0, 0.0, 0.0]"), ["axis"]),
    (("time_step = 1e-4\nmass_damping = 2.0\nnum_outputs = 5\n", SAME_STEPS),
     ["step by step", "give time_step", 'against = "truth"']),
    (("[[tool]]", OF_TRUTH.format("volume")), ["trajectory_l2", "volume", "same_mesh"]),
    (("[[tool]]", OF_TRUTH.format("published_oscillation")), ["needs at, component, quantity"]),
    (("end_time = 0.5", "end_time = 0.0"), ["end_time", "greater than 0"]),
    (("stiffness_damping = 0", "stiffness_damping = -0"), ["stiffness_damping", "equal"]),
    (("max = [1000, 9", "max = [-1, 9"), ["inclusion 1", "selects no cell"]),
    (("region = { box", "region = { group = 'a', box"), ["inclusion 1: no group of cells 'a'"]),
]  # fmt: skip
IN_MILLIMETRES = [
    ([(CLAMP, f"[[support]]\n{PART.replace('0.6', '90').replace('1.6', '99')}")],
     "from [0.0, 0.0, 0.0] to [20.0, 10.0, 10.0] mm"),
    ([check("published_displacement", 'against = "candidate"', "at = [20.0, 0.0, 0.3]",
            'component = "x"', "expected = 1.0"),
      (PULLED, "region = { nearest = [19.9, 0, 0] }"), ('kind = "force"', 'kind = "point_force"')],
     "check 2 at [20.0, 0.0, 0.3] mm: no point of the mesh lies there, the nearest at "
     "[20.0, 0.0, 0.0] mm"),
    ([(BOX.replace("0.5", "5.0").replace("2.0, 1.0, 1.0", "20.0, 10.0, 10.0"),
       'shape = "kidney"\nedge_length = 100.0')], "edge_length = 100 mm is too coarse"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "meant"), MEANT)
def test_a_mistake_in_writing_is_answered_with_what_was_meant(write_case, old, new, meant):
    with pytest.raises(CaseError) as refused:
        load_case(write_case((old, new)))
    assert f"did you mean {meant!r}?" in str(refused.value)
    assert str(refused.value).count("\n") <= 1


@pytest.mark.parametrize(("change", "words"), SCHEMA)
def test_what_the_schema_refuses_is_named_in_at_most_two_lines(write_case, change, words):
    with pytest.raises(CaseError) as refused:
        load_case(write_case(change))
    assert words in str(refused.value)
    assert str(refused.value).count("\n") <= 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [([change], words) for change, words in BUILT]
    + [(moving(change), words) for change, words in MOVING]
    + [([*MILLIMETRES, *changes], words) for changes, words in IN_MILLIMETRES],
)
def test_what_cannot_be_built_is_named_in_the_cases_units(write_case, changes, words):
    with pytest.raises(InputError) as refused:
        _ = load_case(write_case(*changes)).problem
    for word in [words] if isinstance(words, str) else words:
        assert word in str(refused.value)
    assert str(refused.value).count("\n") <= 1


def test_a_missing_key_is_reported_at_its_own_table(write_case):
    path = write_case(("limit = 1e-8\n", ""))
    line = path.read_text("utf-8").split("[[check]]")[0].count("\n") + 1
    with pytest.raises(CaseError, match=rf":{line}: missing key 'check.1.limit'"):
        load_case(path)


# Each key with the text that stands there.
NUMBERS = {
    "limit": "limit = 1e-8",
    "youngs_modulus": "youngs_modulus = 1000.0",
    "poissons_ratio": "poissons_ratio = 0.3",
    "edge_length": "edge_length = 0.5",
    "force": "force = [60.0,",
    "point": "point = [0.001,",
    "size": "size = [2.0,",
}
NOT_NUMBERS = ["true", '"1e300"', "inf", "-nan", "1" + "0" * 400, "2020-01-01", "{}"]


@pytest.mark.parametrize("value", NOT_NUMBERS)
@pytest.mark.parametrize("key", NUMBERS)
def test_what_is_no_finite_number_is_refused_with_line_and_key(write_case, key, value):
    old = NUMBERS[key]
    new = re.sub(r"[-\d.]+(e-8)?(?=,?$)", value, old)
    path = write_case((old, new))
    line = path.read_text("utf-8").split(new)[0].count("\n") + 1
    with pytest.raises(CaseError) as refused:
        load_case(path)
    first = str(refused.value).splitlines()[0]
    assert re.match(rf"{re.escape(str(path))}:{line}: \S*\b{key}\b", first)
    assert len(first) < 300


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("load[1].force", "did you mean 'load[0].force'"),
        ("load[0].forse", "did you mean 'load[0].force'"),
        ("material.density", "the case gives no number"),  # a default is nobody's fit
        ("check[0].limit", "the case gives no number"),
        ("title", "the case gives no number"),
        ("load[0].region", "the case gives no number"),
    ],
)
def test_what_is_said_to_be_fitted_has_to_be_given(write_case, name, hint):
    fitted = f'[evidence]\nfitted = ["material.youngs_modulus", "{name}"]\n'
    with pytest.raises(InputError, match=r"evidence\.fitted") as caught:
        load_case(write_case(before("[geometry]", fitted)))
    assert hint in str(caught.value)
    assert name in str(caught.value)
