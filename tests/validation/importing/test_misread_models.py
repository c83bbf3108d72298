"""Models that were read as something else than their simulator makes of them: refused, each alone.

The first table of each format was found by trying what its manual allows (issue 34); the second by
classes of our own: what is written twice, in another order, beyond what a program reads of a line.
"""

import tomllib
from importlib import resources

import bars
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.validation.importing import ImportRefusedError, UnitSystem, case_files
from palpate.validation.importing.understood import harmless

SI = UnitSystem.METRE_NEWTON
MESH = brick_box((1, 1, 1), bars.SIZE)
PRESSED = bars.PRESSED
CLOAD = "*CLOAD, AMPLITUDE=A\n8, 3, 0.02"


def deck(old, new):
    text = bars.abaqus(MESH, acts=CLOAD, before="*AMPLITUDE, NAME=A\n0., 0., 1., 1.")
    assert old in text
    return text.replace(old, new, 1)


AMPLITUDE = "*AMPLITUDE, NAME=A\n0., 0., 1., 1."
TOTAL = "*AMPLITUDE, NAME=A, TIME=TOTAL TIME\n0., 0., 1., 1."
ISSUE = [
    (AMPLITUDE, f"{AMPLITUDE}\n*AMPLITUDE, NAME=a\n0., 0., 1., 2.", "amplitude A is there twice"),
    ("*STATIC", "*STATIC, TOTAL TIME AT START=1.", "parameter TOTAL TIME AT START is not known"),
    ("*STATIC", "*STATIC, TIME RESET", "parameter TIME RESET is not known"),
    ("*END STEP", "*END STEP\n*CLOAD\n8, 1, 1.", r"\*CLOAD below \*END STEP"),
    ("*END STEP", "*END STEP\n*NODE FILE\nU", r"\*NODE FILE below \*END STEP"),
    ("*CLOAD", "*STEP\n*STATIC\n*CLOAD", "a second step"),
    ("*HEADING", "*RESTART, READ, STEP=1\n*HEADING", r"\*RESTART: parameter READ is not known"),
]
CLASSES = [
    # Fields of a line: one that is left out moved the next to its place; more were not looked at.
    ("0.25, 1.", "0.25, , 0.1", None),
    ("0.1, 0.3", "0.1, , 20.", "'' is no number"),
    ("0.1, 0.3", "0.1, 0.3, 20., 1.", "needs 2 to 3"),
    (AMPLITUDE, "*AMPLITUDE, NAME=A\n0.,0.,.2,0.,.4,0.,.6,0.,1.,1.", "needs 2 to 8"),
    (AMPLITUDE, "*AMPLITUDE, NAME=A\n0., , 1., 1.", "'' is no number"),
    ("\n1, 0.0, 0.0, 0.0\n", "\n1, 0.0, 0.0, 0.0, 1.\n", "needs 1 to 4"),
    ("MATERIAL=TISSUE\n*", "MATERIAL=TISSUE\n1., 2.\n*", "data that are not known"),
    (CLOAD, "*DLOAD\n1, P1, 1e-3, 0., 0., 1.", "6 fields, needs 3"),
    (CLOAD, "*DLOAD\n1, P, 1e-3", r"\*DLOAD of kind 'P'"),
    (CLOAD, "*DSLOAD\nENDFACE, P", r"2 field\(s\) in a line, needs 3"),
    ("*SOLID SECTION, ELSET=ALL, MATERIAL=TISSUE\n", "", "SOLID SECTION"),
    ("HELD, 1, 3", "HELD, ENCASTRE, 3", "3 fields, needs 2"),
    # Numbers of more characters than CalculiX reads: 1.2345678901234567890e-2 is 1.23 there.
    ("0.1, 0.3", "1.2345678901234567890e-1, 0.3", "another number there"),
    # What is said twice.
    ("*ELASTIC", "*DENSITY\n1e-9\n*DENSITY\n2e-9\n*ELASTIC", "two densities"),
    ("*SOLID SECTION, ELSET=ALL", "*SOLID SECTION, ELSET=ALL, ELSET=ALL", "is there twice"),
    (CLOAD, "*DLOAD\nALL, BX, 1e-6\nALL, BX, 1e-6", "a second BX"),
    ("*STATIC\n0.25, 1.", "*STATIC\n0.25, 1.\n*STATIC\n0.25, 2.", r"a second \*STATIC"),
    (CLOAD, f"*BOUNDARY\n8, 1, 1, 0.3\n8, 1, 1, 0.4\n{CLOAD}", "by 0.4 here and by 0.3 in"),
    # A keyword that goes on in the next line does so for Abaqus alone.
    ("*STEP, NLGEOM", "*STEP,\nNLGEOM", "ends with a comma"),
    # What stands in another place.
    ("*BOUNDARY", "*DENSITY\n1e-9\n*BOUNDARY", r"\*DENSITY stands below a \*MATERIAL"),
    (CLOAD, f"*NSET, NSET=HELD\n8\n{CLOAD}", r"\*NSET stands above \*STEP"),
    ("*MATERIAL", f"{CLOAD}\n*MATERIAL", r"\*CLOAD stands in a \*STEP"),
    ("HELD, 1, 3", "HELD, 1, 3, 0.5", "what moves stands in the step"),
    ("*END STEP", "", r"no \*END STEP"),
    ("*STEP, NLGEOM\n*STATIC\n0.25, 1.\n", "", r"\*CLOAD stands in a \*STEP"),
    ("ELSET=ALL\n1,", "ELSET=FEW\n1,", "no set 'ALL'"),
    ("*MATERIAL", "*NODE\n9, 0., 0., 0.\n*MATERIAL", None),
    ("\n8, 3, 0.02", "\n8, 3, 0.02\n9, 3, 1.\n", "no node 9"),
    # Names: of a part that is none, in quotes, with spaces.
    ("HELD, 1, 3", "OTHER.HELD, 1, 3", "no set 'OTHER.HELD'"),
    ("HELD, 1, 3", '"held", 1, 3', "no set 'held'"),
    ("HELD, 1, 3", "H ELD, 1, 3", None),
    # A set of a set that grows: CalculiX takes *NODE before *NSET, wherever they stand.
    (
        "*MATERIAL", "*NSET, NSET=MORE\nHELD\n*NSET, NSET=HELD\n8\n*MATERIAL",
        "set HELD grows after another was made of it",
    ),
    # The end of a line is a line feed and nothing else.
    ("** a comment", "** a comment \x85*DLOAD \x0cALL, BX, 1e-4", None),
    ("*STEP, NLGEOM", "*STEP, NLGEOM=MAYBE", "known is YES or NO"),
    ("*CLOAD", "*CLOAD, OP=OLD", "known are MOD and NEW"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "says"), [*ISSUE, *CLASSES])
def test_a_deck_is_not_read_as_something_else(bring, tmp_path, old, new, says):
    plain, _ = bring(deck("*HEADING", "*HEADING"), ".inp")
    text = deck(old, new)
    if says is None:
        assert bars.apart(plain.problem, bring(text, ".inp")[0].problem) < 1e-12
        return
    (tmp_path / "case.toml").unlink()
    with pytest.raises(ImportRefusedError, match=says) as caught:
        bring(text, ".inp")
    assert caught.value.line


@pytest.mark.parametrize(
    ("sets", "load", "says"),
    [
        ("*ELSET, ELSET=ALL\n1", "*DLOAD\nALL, BX, 1e-6", "set ALL names element 1 twice"),
        ("*NSET, NSET=TIP\n8, 8", "*CLOAD\nTIP, 3, 0.02", "set TIP names node 8 twice"),
        (
            "*ELSET, ELSET=ONE\n2, 2\n*ELSET, ELSET=TOP\nONE, 4",
            "*DLOAD\nTOP, P3, 1e-3",
            "set TOP names element 2 twice",
        ),
    ],
)
def test_a_load_on_what_a_set_names_twice_is_refused(bring, sets, load, says):
    """CalculiX loads it twice: measured, for volumes, faces and nodes."""
    text = deck(CLOAD, load).replace(AMPLITUDE, f"{AMPLITUDE}\n{sets}")
    with pytest.raises(ImportRefusedError, match=says):
        bring(text, ".inp")


def test_a_step_of_two_seconds_ends_there(bring):
    """An amplitude of 1 at its end."""
    plain, _ = bring(deck(AMPLITUDE, AMPLITUDE), ".inp")
    slow = deck(AMPLITUDE, AMPLITUDE.replace("1., 1.", "2., 1.")).replace("0.25, 1.", "0.5, 2.")
    assert bars.apart(plain.problem, bring(slow, ".inp")[0].problem) < 1e-12


def test_displacements_in_too_many_ways_are_refused_by_name(bring, monkeypatch):
    monkeypatch.setattr(case_files, "MOST_TABLES", 2)
    moved = "\n".join(f"{node}, 1, 1, 0.{node}" for node in (5, 6, 7))
    with pytest.raises(ImportRefusedError, match="different ways") as caught:
        bring(deck(CLOAD, f"*BOUNDARY\n{moved}\n{CLOAD}"), ".inp")
    assert caught.value.line


def test_what_is_left_out_is_listed_as_a_whole_or_ends_in_dots(bring, tmp_path, monkeypatch):
    for most, dots in ((30, False), (0, True)):
        monkeypatch.setattr(case_files, "_MOST_SHOWN", most)
        bring(deck("*HEADING", "*HEADING"), ".inp")
        text = (tmp_path / "case.toml").read_text("utf-8")
        (tmp_path / "case.toml").unlink()
        assert ("..." in text.split("left out, for no mechanics")[1].splitlines()[0]) is dots


def test_sets_whose_names_end_alike_are_two_supports(bring):
    sets = "*NSET, NSET=A.N\n1, 2, 3, 4\n*NSET, NSET=B.N\n5, 6, 7, 8\n*MATERIAL"
    text = deck("*MATERIAL", sets).replace("HELD, 1, 3", "HELD, 1, 3\nA.N, 1, 1\nB.N, 2, 2")
    case, _ = bring(text, ".inp")
    fixed = {tuple(s.points.tolist()): s.components for s in case.problem.supports}
    assert fixed[4, 5, 6, 7] == (False, True, False)


PART = (
    ("*NODE,", "*PART, NAME=P\n*NODE,"),
    (
        "*MATERIAL",
        "*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*MORE\n"
        "*END ASSEMBLY\n*MATERIAL",
    ),
)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("*NSET, NSET=HELD, INSTANCE=P-1\n8", "set HELD of the part and of the assembly are two"),
        ("*NODE\n1, 0., 0., 0.", r"\*NODE of the assembly, beside those of its part"),
        ("*NSET, NSET=MORE, INSTANCE=Q-1\n8", "no part Q-1 in the assembly"),
        ("*NSET, NSET=MORE, INSTANCE=P-1\n8", None),
    ],
)
def test_a_part_and_its_assembly_have_names_of_their_own(bring, more, says):
    text = deck("*HEADING", "*HEADING")
    for old, new in PART:
        text = text.replace(old, new.replace("*MORE", more), 1)
    if says is None:
        bring(text.replace("HELD, 1, 3", "P-1.HELD, 1, 3\nMORE, 1, 1"), ".inp")
        return
    with pytest.raises(ImportRefusedError, match=says):
        bring(text, ".inp")


def test_total_time_is_the_time_of_the_only_step(bring):
    plain, _ = bring(deck(AMPLITUDE, AMPLITUDE), ".inp")
    again, _ = bring(deck(AMPLITUDE, TOTAL), ".inp")
    assert bars.apart(plain.problem, again.problem) == 0.0


@pytest.mark.parametrize("kind", ["C3D10", "C3D10H", "C3D10M", "C3D10MH", "C3D10HS", "C3D10T"])
def test_ten_nodes_of_every_quadratic_tetrahedron(bring, kind):
    points, cells = bars.quadratic(MESH)[:2]
    text = bars.abaqus(MESH, acts="*CLOAD\n8, 3, 0.02", points=points, cells=cells)
    assert bring(text.replace("TYPE=C3D10", f"TYPE={kind}"), ".inp")[0].problem.mesh.num_cells > 0


def feb(old, new, version="4.0"):
    text = bars.febio(MESH, loads=PRESSED, version=version)
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('<Module type="solid"/>', '<Module type="solid"><units>SI</units></Module>', "m-N-Pa"),
        ('<Module type="solid"/>', '<Module type="solid"><units>CGS</units></Module>', "'CGS'"),
        (
            'mat="Tissue"/>', 'mat="Tissue"><elem_type>UT4</elem_type></SolidDomain>',
            "<elem_type> in <SolidDomain> is not known",
        ),
        ('mat="Tissue"/>', 'mat="Tissue" elem_type="UT4"/>', "<SolidDomain elem_type=...>"),
        ("</Nodes>", '</Nodes><Nodes><node id="1">0,0,0</node></Nodes>', "id is there twice"),
        ("</Nodes>", '<node id="99">0,0,0,1</node></Nodes>', "needs three numbers, has 4"),
        ("<Control>", "<Control><final_time>9</final_time>", "<final_time> in <Control>"),
        ("<Control>", '<Control><solver type="x"/>', "<solver type=...>"),
        ("<time_steps>10</time_steps>", "", "give both, or none"),
        # What another version of the format has: FEBio 4 does not look at it.
        ('node_set="Held"><x_dof>1</x_dof>', 'bc="x" node_set="Held">', "<bc bc=...> is not known"),
        ("<x_dof>1</x_dof>", "<dofs>x</dofs>", "<dofs> in <bc> is not known"),
        ('type="loadcurve"', 'type="loadcurve" extend="repeat"', "<load_controller extend=...>"),
        ("<analysis>STATIC", '<analysis type="static">DYNAMIC', "analysis 'dynamic'"),
        # FEBio's -1 is: until the final time.
        ("<time_steps>10", "<time_steps>-1", "-1 steps of 0.1: whole steps"),
        ("<time_steps>10", "<time_steps>10.5", "10.5 steps of 0.1: whole"),
        ("<step_size>0.1", "<step_size>0", "10 steps of 0: whole steps above 0"),
        ("<Mesh>", "<Geometry/><Mesh>", "<Geometry> is of another version than 4.0"),
        (
            "<LoadData>", '<LoadData><load_controller id="2" type="math"><math>t</math>'
            "</load_controller>", "'math' is no load curve",
        ),
        ("LINEAR</interpolate>", "STEP</interpolate>", "a step curve; known are"),
        # A curve of control points does not go through them, not even at the end of the step.
        ("<pt>2,1</pt>", "<pt>1,1</pt><pt>2,0</pt>", None),
        (
            "LINEAR</interpolate><points><pt>0,0</pt><pt>2,1</pt>",
            "CONTROL POINTS</interpolate><points><pt>0,0</pt><pt>1,1</pt><pt>2,1</pt>",
            "a control points curve",
        ),
        # FEBio reads numbers by atof: what Fortran wrote is another number there.
        ("<E>0.1", "<E>1d-1", "'1d-1' is no number"),
        ("<E>0.1", "<E>&#x661;", "'\u0661' is no number"),
        ("<E>0.1", "<E>0.1<x/>", "<x> in <E> is not known"),
        ("<Boundary>", "<Boundary>x", "text in <Boundary>"),
        ("<E>", '<E units="kPa">', "<E units=...> is not known"),
        ("<Mesh>", '<Mesh><Nodes name="more"><Node/></Nodes>', "<Node> in <Nodes> is not known"),
        ('<Elements type="tet4"', '<Elements mat="2" type="tet4"', "<Elements mat=...>"),
        ("<MeshDomains>", '<MeshDomains><SolidDomain name="Part1" mat="x"/>', "a second domain"),
    ],
)  # fmt: skip
def test_a_feb_is_not_read_as_something_else(bring, old, new, says):
    if says is None:
        bring(feb(old, new), ".feb")
        return
    with pytest.raises(ImportRefusedError, match=says) as caught:
        bring(feb(old, new), ".feb")
    assert caught.value.line


@pytest.mark.parametrize(
    ("said", "system"),
    [
        ("SI", UnitSystem.METRE_NEWTON),
        ("mm-N-s", UnitSystem.MILLIMETRE_NEWTON),
        ("mm-kg-s", UnitSystem.MILLIMETRE_MILLINEWTON),
    ],
)
def test_units_that_a_feb_states_need_not_be_given(bring, said, system):
    text = feb('<Module type="solid"/>', f'<Module type="solid"><units>{said}</units></Module>')
    stated, given = bring(text, ".feb", None)[0], bring(text, ".feb", system)[0]
    assert stated.problem.material == given.problem.material
    # A density of 1e-9 in force s2 / length4.
    assert stated.problem.material.density == pytest.approx(
        {"SI": 1e-9, "mm-N-s": 1e3, "mm-kg-s": 1.0}[said]
    )


MJCF = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"><flag contact="disable"/>
</option><worldbody><flexcomp name="b" type="direct" dim="3" mass="0.4"
point="0 0 0 0.1 0 0 0 0.1 0 0.03 0.03 0.1" element="0 1 2 3">
<elasticity young="5e3" poisson="0.3"/><pin id="0 1 2"/></flexcomp></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("<option", "<default><joint stiffness='9'/></default><option", "<joint> in <default>"),
        ("<compiler", "<compiler settotalmass='3'", "<compiler settotalmass=...> is not known"),
        ("<option", "<option wind='9 0 0'", "<option wind=...>"),
        ("<option", "<option density='1000'", "<option density=...>"),
        ("<option", "<option viscosity='1'", "<option viscosity=...>"),
        ("<flag", "<flag spring='disable'", "<flag spring=...>"),
        # Options that are given twice, of which the reader took the first, MuJoCo both.
        ("<worldbody>", "<option gravity='0 0 -1'/><worldbody>", "<option> is there twice"),
        ("<compiler", "<compiler boundmass='3'", "<compiler boundmass=...>"),
        ("0.03 0.03 0.1\"", "0.03 0.03 0.1 0 0 1\"", "a point of no element"),
        ('gravity="0 0 -9.81"', 'gravity="0,0,-9.81"', "no number"),
        ('gravity="0 0 -9.81"', 'gravity="0 0 -9d0"', "no number"),
        ("<elasticity", "<elasticity yield='1'", "<elasticity yield=...>"),
        ("<worldbody>", "<worldbody><![CDATA[<light/>]]>", "text in <worldbody>"),
        ("<worldbody>", "<worldbody><frame pos='0 0 1'/>", "<frame> in <worldbody>"),
        ("<mujoco>", "<mujoco xmlns='x'>", "<mujoco xmlns=...>"),
        ("mass=\"0.4\"", "mass=\"0.4 0.5\"", "needs one number"),
    ],
)  # fmt: skip
def test_an_mjcf_is_not_read_as_something_else(bring, old, new, says):
    assert old in MJCF
    with pytest.raises(ImportRefusedError, match=says) as caught:
        bring(MJCF.replace(old, new, 1), ".xml", SI)
    assert caught.value.line


def test_a_body_that_may_touch_itself_is_noted(bring):
    assert not any("through itself" in line for line in bring(MJCF, ".xml", SI)[1].notes)
    text = MJCF.replace('<flag contact="disable"/>', "")
    assert any("through itself" in line for line in bring(text, ".xml", SI)[1].notes)


def test_a_slide_along_one_axis_twice_is_refused(bring):
    joints = '<joint type="slide" axis="1 0 0"/>' * 2 + '<joint type="slide" axis="0 1 0"/>'
    text = f"""<mujoco><worldbody><body name="b" pos="0 0 1"><inertial pos="0 0 0" mass="0.1"/>
{joints}<joint type="slide"/></body></worldbody><deformable><flex name="f" dim="3"
body="world world world b" vertex="0 0 0 1 0 0 0 1 0 0 0 0" element="0 1 2 3">
<elasticity young="1e4" poisson="0.3"/></flex></deformable></mujoco>"""
    with pytest.raises(InputError, match="slides along x, y and z"):
        bring(text, ".xml", SI)


@pytest.mark.parametrize("program", ["abaqus", "febio", "mujoco"])
def test_each_harmless_thing_has_its_source(program):
    assert harmless(program)
    text = (resources.files("palpate.validation.importing") / "harmless.toml").read_text("utf-8")
    for row in tomllib.loads(text)[program]:
        assert len(row["source"].split()) > 2, row
