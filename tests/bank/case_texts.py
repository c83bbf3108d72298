"""A small case as text, and what is put instead of parts of it."""

BOX = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
MODULI = "youngs_modulus = 1000.0\npoissons_ratio = 0.3\n"
SIDE = "region = {{ half_space = {{ point = {}, normal = {} }} }}\n"
ROOT = SIDE.format([0.001, 0.0, 0.0], [-1.0, 0.0, 0.0])
FLOOR = SIDE.format([0.0, 0.0, 0.001], [0.0, 0.0, -1.0])
BACK = SIDE.format([0.0, 0.001, 0.0], [0.0, -1.0, 0.0])
END = SIDE.format([1.999, 0.0, 0.0], [1.0, 0.0, 0.0])
CLAMP = f"[[support]]\n{ROOT}".rstrip()
FORCE = 'kind = "force"\nforce = [60.0, 20.0, -10.0]'
LOAD = "[[load]]"
# Before the last check.
CHECK = '\n[[check]]\nmetric = "smallest_det_f"'
BLOCK = f"""
schema = 1
title = "A block pulled sideways"

[geometry]
{BOX}

[material]
{MODULI}
{CLAMP}

[[load]]
{FORCE}
{END}
[[check]]
metric = "displacement_l2"
limit = 1e-8
reason = "same equations"
{CHECK}
against = "candidate"
limit = 0.0
reason = "nothing inverted"
"""

RIVLIN = 'law = "mooney-rivlin"\nc10 = 1.0\nc01 = 0.5\nbulk_modulus = 10.0\n'
OGDEN = 'law = "ogden"\nmu_1 = 2.0\nalpha_1 = 1.5\nbulk_modulus = 10.0\n'
VALUES = """kind = "traction"
values = [
    { at = [2, 0, 0], traction = [0, 0, 0] },
    { at = [2, 1, 0], traction = [0, 0, 8] },
    { at = [2, 0, 1], traction = [4, 0, 0] },
]"""
PARABOLA = """kind = "traction"
traction = [0.0, 0.0, 30.0]
profile = "parabolic"
start = [2, 0, 0]
end = [2, 0, 1]"""
LIQUID = """kind = "traction"
profile = "hydrostatic"
density = 1000.0
gravity = [0.0, 0.0, -10.0]
free_surface = [7.0, 7.0, 1.5]"""
MOMENT = 'kind = "moment"\nmoment = [0.0, 5.0, 0.0]'
SPRING = """[[spring]]
center = [1.5, 0.5, 1.0]
radius = 0.6
stiffness = 80.0
displacement = [0.1, 0.0, 0.3]

[[load]]"""
MILLIMETRES = (
    ("[geometry]", '[units]\nlength = "mm"\nstress = "kPa"\n[geometry]'),
    (BOX, BOX.replace("0.5", "5.0").replace("2.0, 1.0, 1.0", "20.0, 10.0, 10.0")),
)
# A motion with an inclusion and a tool, in millimetres.
MOVING = f"""
[time]
end_time = 0.5
stiffness_damping = 0.01
time_step = 1e-4
mass_damping = 2.0
num_outputs = 5

[[inclusion]]
region = {{ box = {{ min = [-1, -1, -1], max = [1000, 9000, 9000] }} }}
material = {{ youngs_modulus = 5.0, poissons_ratio = 0.4, density = 1200.0 }}

[[tool]]
shape = "capsule"
radius = 100.0
half_length = 250.0
friction_coefficient = 0.1
contact = "facets"
region = {{ half_space = {{ point = [0.0, 0.0, 999.0], normal = [0.0, 0.0, 1.0] }} }}

[[tool.pose]]
time = 0.0
position = [1000.0, 500.0, 1101.0]
rotation = {{ axis = [0.0, 2.0, 0.0], angle_deg = 90.0 }}

[[tool.pose]]
time = 0.5
position = [1000.0, 500.0, 1001.0]
rotation = {{ axis = [0.0, 2.0, 0.0], angle_deg = 90.0 }}
{CHECK}"""
SMOOTH = "amplitude = { times = [0, 1], factors = [0, 2], smooth = true }\n"


def changed(text, *changes):
    """A text with parts replaced, each of which is there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def moving(*changes):
    """What makes the block that motion, with changes of the motion's own text."""
    return [
        ("\n[geometry]", '\n[units]\nlength = "mm"\nstress = "kPa"\n\n[geometry]'),
        ("[2.0, 1.0, 1.0]", "[2000.0, 1000.0, 1000.0]"),
        ("edge_length = 0.5", "edge_length = 500.0"),
        ("[1.999, 0.0, 0.0]", "[1999.0, 0.0, 0.0]"),
        ("force = [60", SMOOTH + "force = [60"),
        (CHECK, changed(MOVING, *changes)),
    ]
