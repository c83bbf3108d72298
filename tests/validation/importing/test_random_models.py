"""Models from the grammar of each format, with random additions: refused with their line, or equal.

What CalculiX and MuJoCo make of the file itself is what the imported case has to give, on the same
mesh: to the digits that CalculiX prints, to 1e-6 for MuJoCo. FEBio is not run here: there an
addition has to be refused, or leave the case as it was without it.
"""

import re

import bars
import numpy as np
import pytest
import simulators
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.validation.case import load_case
from palpate.validation.importing import ImportRefusedError, UnitSystem, import_model

FEW = settings(
    max_examples=20, deadline=None, derandomize=True, database=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
MANY = settings(FEW, max_examples=1500)


def imported(path, units):
    """The case; None where the model is refused, which has to name a line."""
    target = path.with_name("case.toml")
    try:
        import_model(path, target, units)
    except ImportRefusedError as error:
        if error.line is None:
            raise
        return None
    except InputError:
        return None
    return load_case(target)


# ------------------------------------------------------------------------------------- CalculiX
MATERIALS = (
    ("*ELASTIC", "0.1, 0.3"),
    ("*ELASTIC, TYPE=ISO", "1.D-1, .3, 20."),
    ("*HYPERELASTIC, NEO HOOKE", "0.02, 12.5"),
    ("*HYPERELASTIC, MOONEY-RIVLIN", "0.015, 0.005, 12.5"),
)
ACTS = (
    ("*CLOAD", "12, 3, 1e-3"),
    ("*CLOAD, AMPLITUDE=A", "11, 1, 0.02", "12, 2, -1d-3"),
    ("*DSLOAD", "ENDFACE, P, -1e-3"),
    ("*DLOAD, AMPLITUDE=A", "ALL, GRAV, 9810., 0., 3., -4."),
    ("*DLOAD", "ALL, BX, 4e-6"),
    ("*BOUNDARY", "END, 3, 3, 0.5"),
    ("*BOUNDARY, AMPLITUDE=A", "12, 1, 1, 1."),
)
# Parameters of those cards, or of others, in the two manuals.
PARAMETERS = (
    "NSET=MORE", "ELSET=MORE", "SYSTEM=C", "SYSTEM=R", "TYPE=C3D4", "TYPE=ISO", "TYPE=ORTHO",
    "TYPE=VELOCITY", "TYPE=DISPLACEMENT", "OP=NEW", "OP=MOD", "AMPLITUDE=A", "AMPLITUDE=B",
    "LOAD CASE=2", "FIXED", "USER", "SUBMODEL", "TIME DELAY=0.5", "FOLLOWER", "SECTOR=1",
    "NLGEOM", "NLGEOM=NO", "NLGEOM=YES", "PERTURBATION", "INC=500", "AMPLITUDE=STEP", "NAME=A",
    "DIRECT", "SOLVER=SPOOLES", "TIME RESET", "TOTAL TIME AT START=1.", "TIME=TOTAL TIME",
    "TIME=STEP TIME", "VALUE=ABSOLUTE", "SHIFTX=0.5", "SHIFTY=0.5", "DEFINITION=PERIODIC",
    "SMOOTH=0.2", "GENERATE", "ORIENTATION=O", "COMPOSITE", "MATERIAL=OTHER", "ELSET=ALL",
    "MODULI=LONG TERM", "UNSORTED", "REAL", "N=1", "EXTRAPOLATION=NO", "ALPHA=0.1",
    "REMOVE", "PRESSURE=3",
)  # fmt: skip
OTHERS = (
    "*AMPLITUDE, NAME=A\n0., 0., 1., 2.", "*AMPLITUDE, NAME=B\n0., 0., 1., 2.",
    "*MATERIAL, NAME=OTHER\n*ELASTIC\n0.3, 0.2", "*DENSITY\n2e-9", "*ELASTIC\n0.2, 0.3",
    "*EXPANSION\n1e-3", "*DAMPING, ALPHA=5.", "*CONDUCTIVITY\n3.", "*SPECIFIC HEAT\n3.",
    "*PLASTIC\n1e-5, 0.", "*USER MATERIAL, CONSTANTS=1\n1.", "*DEPVAR\n3",
    "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALLNODES, 20.",
    "*INITIAL CONDITIONS, TYPE=STRESS\n1, 1, 1e-3, 0., 0., 0., 0., 0.",
    "*TEMPERATURE\nALLNODES, 40.", "*ORIENTATION, NAME=O\n0., 1., 0., 1., 0., 0.",
    "*TRANSFORM, NSET=END, TYPE=R\n0., 1., 0., 1., 0., 0.",
    "*EQUATION\n2\n11, 3, 1., 12, 3, -1.", "*MPC\nPLANE, 9, 10, 11, 12",
    "*RIGID BODY, NSET=END, REF NODE=12", "*ELSET, ELSET=SOME\n1, 2", "*NSET, NSET=HELD\n12",
    "*NSET, NSET=END\n1", "*ELSET, ELSET=ALL\n1", "*SOLID SECTION, ELSET=ALL, MATERIAL=OTHER",
    "*SOLID SECTION, ELSET=SOME, MATERIAL=TISSUE", "*SURFACE, NAME=ENDFACE\n1, S1",
    "*SURFACE, NAME=MORE\n1, S1", "*BOUNDARY\nEND, 1, 3, 0.3", "*BOUNDARY\n12, 2, 6",
    "*BOUNDARY\nHELD, 1, 6", "*BOUNDARY, OP=NEW\nHELD, 1, 3", "*CLOAD\n12, 1, 1e-3",
    "*CLOAD\n12, 4, 1e-3", "*DLOAD\nALL, GRAV, 9810., 0., 0., -1.", "*DLOAD\nALL, BY, 1e-6",
    "*DLOAD\n1, P1, 1e-3", "*DLOAD\nSOME, BX, 1e-6", "*DLOAD\nALL, CENTRIF, 1., 0.,0.,0.,0.,0.,1.",
    "*STEP", "*STEP, NLGEOM\n*STATIC\n*END STEP", "*END STEP", "*STATIC", "*STATIC\n0.1, 2.",
    "*RESTART, READ, STEP=1", "*RESTART, WRITE, FREQUENCY=1", "*NODE FILE\nU", "*EL FILE\nS",
    "*EL PRINT, ELSET=ALL\nS", "*CONTROLS, PARAMETERS=LINE SEARCH\n, 1.01",
    "*CONTROLS, PARAMETERS=CONTACT\n0.1", "*MODEL CHANGE, TYPE=ELEMENT, REMOVE\nSOME",
    "*CHANGE MATERIAL, NAME=TISSUE\n*CHANGE PLASTIC\n1.", "*TIME POINTS, NAME=T\n0.5, 1.",
    "*PHYSICAL CONSTANTS, ABSOLUTE ZERO=0.", "*VISCO\n0.1, 1.", "*DYNAMIC\n0.1, 1.",
    "*HEADING\nmore", "*NODE\n12, 50., 10., 10.", "*NODE\n99, 0., 0., 0.", "*NODE OUTPUT\nU",
    "*ELEMENT, TYPE=C3D4, ELSET=ALL\n99, 1, 2, 3, 5", "*INCLUDE, INPUT=more.inc", "** a comment",
    "*SPRING, ELSET=SOME\n\n1.", "*MASS, ELSET=SOME\n1.", "*TIE, NAME=T\nENDFACE, ENDFACE",
    "*DSLOAD\nENDFACE, P, 1e-3", "*DSLOAD\nMORE, P, 1e-3", "*DSLOAD\nENDFACE, P1, 1e-3",
    "*COUPLING, REF NODE=12, SURFACE=ENDFACE, CONSTRAINT NAME=C\n*KINEMATIC\n1, 3",
    "*DISTRIBUTING COUPLING, ELSET=SOME\n12, 1.", "*BASE MOTION, DOF=1, AMPLITUDE=A",
    "*NO ANALYSIS", "*FUNNY CARD\n1, 2, 3",
)  # fmt: skip
NUMBERS = ("1", "0.5", "-2.", "", "1d0", "ENDFACE", "NEW")


def base_cards(material, acts, is_green, density):
    """Cards of a bar of twelve nodes, each a list of lines."""
    mesh = brick_box((2, 1, 1), bars.SIZE, ragged=0.0)
    step = "*STEP, NLGEOM, INC=300" if is_green else "*STEP"
    text = bars.abaqus(mesh, material="\n".join(material), step=step, acts="*ACTS")
    text = text.replace("0.25, 1.", "0.01, 1., 0.001, 0.01" if is_green else "1., 1.")
    if density:
        text = text.replace("*SOLID", "*DENSITY\n1e-9\n*SOLID", 1)
    text = text.replace("*BOUNDARY", "*AMPLITUDE, NAME=A\n0., 0., 1., 0.5, 2., 3.\n*BOUNDARY", 1)
    text = text.replace("*ACTS", "\n".join(line for act in acts for line in act))
    cards = []
    for line in text.strip().splitlines():
        if line.startswith("*") and not line.startswith("**"):
            cards.append([])
        cards[-1].append(line)
    return cards


@st.composite
def decks(draw):
    """Text of an input file, and of one that it may include."""
    material = draw(st.sampled_from(MATERIALS))
    acts = draw(st.lists(st.sampled_from(ACTS), min_size=1, max_size=2, unique=True))
    is_green = "HYPER" in material[0] or draw(st.booleans())
    cards = base_cards(material, acts, is_green, density=draw(st.integers(0, 3)) > 0)
    if draw(st.booleans()):
        # Two materials: the second is a copy, twice as stiff.
        words = "*SOLID SECTION, ELSET=ALL, MATERIAL=TISSUE"
        at = next(k for k, card in enumerate(cards) if card[0] == words)
        stiff = re.sub(r"^[\d.D-]+", "0.2" if "ELASTIC" in material[0] else "0.04", material[1])
        cards[at:at] = [
            ["*ELSET, ELSET=SOFT, GENERATE", "1, 7"], ["*ELSET, ELSET=STIFF", "8, 9, 10, 11, 12"],
            ["*SOLID SECTION, ELSET=SOFT, MATERIAL=TISSUE"], ["*MATERIAL, NAME=OTHER"],
            [material[0], stiff], ["*SOLID SECTION, ELSET=STIFF, MATERIAL=OTHER"],
        ]  # fmt: skip
        cards.remove([words])
    for _ in range(draw(st.integers(0, 2))):
        spot = draw(st.integers(0, len(cards) - 1))
        match draw(st.integers(0, 6)):
            case 0 | 1:
                # Most are understood in some places alone: below the material, in the step.
                cards.insert(spot + 1, draw(st.sampled_from(OTHERS)).split("\n"))
            case 2 | 3:
                # Large blocks have many lines, but one card: all have the same chance.
                cards[spot][0] += ", " + draw(st.sampled_from(PARAMETERS))
            case 4:
                row = draw(st.integers(0, len(cards[spot]) - 1))
                cards[spot][row] += ", " + draw(st.sampled_from(NUMBERS))
            case 5:
                cards.insert(draw(st.integers(0, len(cards))), list(cards[spot]))
            case 6:
                cards.insert(draw(st.integers(0, len(cards) - 1)), cards.pop(spot))
    text = "\n".join(line for card in cards for line in card) + "\n"
    if draw(st.integers(0, 4)) == 0:
        text = text.lower().replace("\n", " \n")
    return text


def agree_with_calculix(folder, text):
    path = folder / "model.inp"
    path.write_text(text, encoding="latin-1")
    (folder / "more.inc").write_text("*DENSITY\n3e-9\n")
    case = imported(path, UnitSystem.MILLIMETRE_NEWTON)
    assume(case is not None)
    # What only Abaqus reads, or what it cannot solve, says nothing.
    assume(simulators.agree_with_ccx(folder, text, case, 1e-3))


@pytest.mark.long
@simulators.needs_ccx
@FEW
@given(text=decks())
def test_a_deck_is_refused_or_is_what_calculix_makes_of_it(tmp_path_factory, text):
    agree_with_calculix(tmp_path_factory.mktemp("deck"), text)


@pytest.mark.nightly
@pytest.mark.timeout(0)
@simulators.needs_ccx
@MANY
@given(text=decks())
def test_many_decks_are_refused_or_are_what_calculix_makes_of_them(tmp_path_factory, text):
    agree_with_calculix(tmp_path_factory.mktemp("deck"), text)


# --------------------------------------------------------------------------------------- MuJoCo
MADE = """<mujoco model="m">
<compiler angle="radian"/>
<option timestep="0.001" gravity="0 0 -9.81"><flag contact="disable"/></option>
<worldbody>
<light pos="0 0 3"/>
<flexcomp name="b" type="direct" dim="3" mass="0.5" radius="0.001" pos="0.1 0 0" point="POINTS" \
element="CELLS">
<elasticity young="3e4" poisson="0.3" damping="0.01"/>
<edge damping="0.1"/>
<contact selfcollide="none"/>
<pin id="PINS"/>
</flexcomp>
</worldbody>
</mujoco>
"""
WRITTEN = """<mujoco model="m">
<compiler angle="radian"/>
<option timestep="0.001" gravity="0 0 -9.81"><flag contact="disable"/></option>
<worldbody>
BODIES
</worldbody>
<deformable>
<flex name="b" dim="3" radius="0.001" body="NAMES" vertex="VERTICES" element="CELLS">
<elasticity young="3e4" poisson="0.3" damping="0.01"/>
<edge damping="0.1"/>
<contact selfcollide="none"/>
</flex>
</deformable>
</mujoco>
"""
ONE = """<body name="NAME" pos="PLACE">
<inertial pos="0 0 0" mass="0.05" diaginertia="1e-6 1e-6 1e-6"/>
<joint type="slide" axis="1 0 0"/>
<joint type="slide" axis="0 1 0"/>
<joint type="slide" axis="0 0 1"/>
</body>
"""
# Of the XML reference; by the tag they are written into, and with values that would matter.
ATTRIBUTES = {
    "mujoco": ("model='x'",),
    "compiler": (
        "settotalmass='3'", "boundmass='0.2'", "autolimits='false'", "inertiafromgeom='true'",
        "balanceinertia='true'", "fusestatic='true'", "discardvisual='true'", "meshdir='x'",
        "assetdir='x'", "texturedir='x'", "alignfree='true'", "eulerseq='zyx'", "usethread='false'",
    ),
    "option": (
        "wind='30 0 0'", "wind='0 0 0'", "density='1000'", "density='0'", "viscosity='1'",
        "integrator='RK4'", "solver='CG'", "iterations='3'", "o_margin='1'", "magnetic='1 0 0'",
        "impratio='5'", "cone='elliptic'", "jacobian='sparse'", "tolerance='1e-3'",
        "sleep_tolerance='9'", "actuatorgroupdisable='0'",
    ),
    "flag": (
        "spring='disable'", "spring='enable'", "damper='disable'", "gravity='disable'",
        "constraint='disable'", "equality='disable'", "override='enable'", "energy='enable'",
        "eulerdamp='disable'", "sleep='enable'", "ipc='enable'", "multiccd='enable'",
        "limit='disable'", "diagexact='disable'",
    ),
    "flexcomp": (
        "scale='2 1 1'", "quat='0 1 0 0'", "euler='0 0 1'", "origin='1 0 0'", "rigid='true'",
        "dof='trilinear'", "dof='full'", "inertiabox='0.1'", "count='2 2 2'", "spacing='1 1 1'",
        "cellcount='1 1 1'", "flatskin='true'", "group='2'", "rgba='1 0 0 1'", "file='x.msh'",
        "mesh='x'",
    ),
    "flex": (
        "group='2'", "flatskin='true'", "cellcount='1 1 1'", "dof='full'", "node='b1'",
        "nodecoord='0 0 0'", "rgba='1 0 0 1'",
    ),
    "elasticity": (
        "thickness='0.01'", "elastic2d='none'", "elastic2d='both'", "shear='3'", "yield='1'",
        "section='rect'", "sectionsize='0.1 0.1'",
    ),
    "edge": ("stiffness='20'", "equality='true'", "equality='false'", "solref='-100 -1'"),
    "contact": ("internal='true'", "margin='0.1'", "passive='true'", "condim='1'", "gap='1'"),
    "pin": ("grid='0 0 0'", "gridrange='0 0 0 1 1 1'", "range='0 1'"),
    "body": (
        "gravcomp='1'", "mocap='true'", "quat='0 1 0 0'", "euler='0 0 1'", "childclass='c'",
        "sleep='auto'", "user='1'",
    ),
    "inertial": ("quat='0 1 0 0'", "euler='0 0 1'"),
    "joint": (
        "stiffness='30'", "springref='0.1'", "damping='2'", "frictionloss='1'", "armature='1'",
        "ref='0.1'", "range='-0.001 0.001'", "limited='true'", "actuatorgravcomp='true'",
        "group='2'", "pos='1 0 0'", "springyield='1'", "springdamper='1 1'",
    ),
}  # fmt: skip
ELEMENTS = (
    "<default><joint stiffness='30'/></default>", "<default><joint armature='1'/></default>",
    "<default><geom density='9'/></default>", "<default><site rgba='1 0 0 1'/></default>",
    "<default class='main'><default class='c'><joint stiffness='9'/></default></default>",
    "<visual><global fovy='40'/></visual>", "<statistic meanmass='3'/>", "<size memory='1M'/>",
    "<custom><numeric name='n' data='1'/></custom>", "<asset><material name='k'/></asset>",
    "<option gravity='0 0 -1'/>", "<option><flag gravity='disable'/></option>",
    "<option density='9' viscosity='9' wind='9 0 0'/>", "<include file='more.xml'/>",
    "<geom type='plane' size='1 1 0.1'/>", "<site name='s'/>", "<body name='z'/>",
    "<camera name='k'/>", "<joint type='slide' axis='1 0 0' stiffness='9'/>", "<freejoint/>",
    "<body name='z' pos='0 0 1'><freejoint/><geom size='0.1'/></body>", "<contact/>",
    "<equality><flex flex='b'/></equality>", "<equality/>", "<keyframe><key qpos='1'/></keyframe>",
    "<actuator><motor joint='b_1' ctrlrange='1 2'/></actuator>", "<elasticity young='9'/>",
    "<edge stiffness='9'/>", "<pin id='0'/>", "<pin range='0 1'/>", "<plugin plugin='x'/>",
    "<frame pos='0 0 1'><site/></frame>", "<compiler settotalmass='9'/>", "<worldbody/>",
    "<worldbody><light/></worldbody>", "<!-- a comment -->", "some text", "<sensor/>",
    "<contact selfcollide='auto'/>", "<deformable/>", "<inertial pos='0 0 0' mass='1'/>",
    "<replicate count='2'><site/></replicate>", "<extension/>", "<Option gravity='0 0 -1'/>",
    "<composite prefix='q' type='cable' count='2 1 1'/>", "<skin/>",
)  # fmt: skip


def flat(values):
    return " ".join(repr(v) for v in np.ravel(values).tolist())


def mjcf(is_written):
    """A bar of eight points, four of them pinned, without additions."""
    mesh = brick_box((1, 1, 1), (0.1, 0.1, 0.1), ragged=0.0)
    pins = np.flatnonzero(mesh.points[:, 0] == 0.0).tolist()
    if not is_written:
        text = MADE.replace("POINTS", flat(mesh.points)).replace("PINS", flat(pins))
        return text.replace("CELLS", flat(mesh.cells))
    names = ["world" if k in pins else f"b{k}" for k in range(8)]
    free = [k for k in range(8) if k not in pins]
    bodies = [ONE.replace("NAME", f"b{k}").replace("PLACE", flat(mesh.points[k])) for k in free]
    vertices = mesh.points.copy()
    vertices[free] = 0.0
    text = WRITTEN.replace("BODIES\n", "".join(bodies)).replace("NAMES", " ".join(names))
    return text.replace("VERTICES", flat(vertices)).replace("CELLS", flat(mesh.cells))


@st.composite
def mjcfs(draw):
    """Text of a model with up to two additions."""
    lines = mjcf(draw(st.booleans())).strip().splitlines()
    for _ in range(draw(st.integers(0, 2))):
        spot = draw(st.integers(1, len(lines) - 1))
        if draw(st.booleans()):
            lines.insert(spot, draw(st.sampled_from(ELEMENTS)))
            continue
        tag = draw(st.sampled_from([t for t in ATTRIBUTES if f"<{t} " in "\n".join(lines)]))
        where = draw(st.sampled_from([k for k, line in enumerate(lines) if f"<{tag} " in line]))
        added = draw(st.sampled_from(ATTRIBUTES[tag]))
        lines[where] = lines[where].replace(f"<{tag} ", f"<{tag} {added} ", 1)
    return "\n".join(lines) + "\n"


def agree_with_mujoco(folder, text, mujoco):
    path = folder / "model.xml"
    path.write_text(text)
    (folder / "more.xml").write_text("<mujoco><option gravity='0 0 -1'/></mujoco>")
    case = imported(path, UnitSystem.METRE_NEWTON)
    assume(case is not None)
    # A word of an older version, or no equilibrium.
    assume(mujoco.agree(path, case))


@pytest.mark.long
@FEW
@given(text=mjcfs())
def test_an_mjcf_is_refused_or_is_what_mujoco_makes_of_it(tmp_path_factory, mujoco, text):
    agree_with_mujoco(tmp_path_factory.mktemp("mjcf"), text, mujoco)


@pytest.mark.nightly
@pytest.mark.timeout(0)
@MANY
@given(text=mjcfs())
def test_many_mjcfs_are_refused_or_are_what_mujoco_makes_of_them(tmp_path_factory, mujoco, text):
    agree_with_mujoco(tmp_path_factory.mktemp("mjcf"), text, mujoco)


# ---------------------------------------------------------------------------------------- FEBio
# Tags and attributes of the user's manual that change what is solved, by the tag they go into, and
# those that do not. FEBio is not installed where this runs: the two lists are the manual's word.
FEBIO_CHANGES = {
    "febio_spec": (
        "<Include>x.feb</Include>", "<Constraints><constraint type='volume'/></Constraints>",
        "<Contact><contact type='sticky'/></Contact>", "<Initial><ic type='prestrain'/></Initial>",
        "<MeshData><ElementData/></MeshData>", "<Rigid><rigid_bc/></Rigid>", "<StepData/>text",
        "<Discrete><discrete_material/></Discrete>", "<Boundary from='x.feb'/>",
        "<Step><step id='1'/><step id='2'/></Step>", "<Control/>", "<Plugins/>",
    ),
    "Control": (
        "<analysis>DYNAMIC</analysis>", "<time_steps>20</time_steps>", "<final_time>2</final_time>",
        "<integration/>", "<restart/>",
        "<solver type='explicit-solid'/>", "<solver><arc_length>1</arc_length></solver>",
        "<use_three_field_tet>1</use_three_field_tet>",
    ),
    "material": (
        "<E>0.7</E>", "<mat_axis type='local'>1,2,3</mat_axis>", "<prestrain/>", "<k>3</k>",
        "<density>2e-9</density>", "<active_contraction/>", "<solid type='neo-Hookean'/>",
    ),
    "SolidDomain": (
        "<shell_thickness>2</shell_thickness>", "<alpha>0.5</alpha>", "<elem_type>UT4</elem_type>",
    ),
    "Boundary": (
        "<bc type='rigid' node_set='End'><rb>1</rb></bc>", "<contact type='tied'/>",
        "<bc type='normal displacement' surface='EndFace'><scale>1</scale></bc>",
    ),
    "bc": ("<relative>1</relative>", "<shell_bottom>1</shell_bottom>", "<dof>u</dof>"),
    "surface_load": (
        "<linear>1</linear><linear>0</linear>", "<shell_bottom>1</shell_bottom>",
        "<value>3</value>", "<traction>0,0,1</traction>",
    ),
    "Loads": (
        "<edge_load type='force'/>", "<body_load type='centrifugal'/>",
        "<body_load type='non-const'><x>1</x></body_load>", "<nodal_load type='moment'/>",
        "<nodal_load node_set='End' bc='p'><scale>1</scale></nodal_load>",
    ),
    "load_controller": (
        "<extend>REPEAT</extend><extend>CONSTANT</extend>", "<interpolate>STEP</interpolate>",
        "<math>t</math>", "<scale>3</scale>",
    ),
    "LoadData": (
        "<load_controller id='2' type='PID'/>", "<load_controller id='2' type='math'/>",
        "<load_controller id='1' type='loadcurve'/>", "<loadcurve id='3' type='step'/>",
    ),
    "Mesh": (
        "<Part name='p'/>", "<DiscreteSet name='d'/>", "<Edge name='e'/>", "<Nodes><node/></Nodes>",
        "<NodeSet name='Held'>1</NodeSet>", "<Elements type='hex20' name='h'/>",
    ),
    "MeshDomains": (
        "<ShellDomain name='s' mat='Tissue'/>", "<BeamDomain name='b' mat='Tissue'/>",
        "<SolidDomain name='Part1' mat='Tissue'/>",
    ),
    "Module": ("<units>SI</units>", "<units>CGS</units>", "<physics/>"),
}  # fmt: skip
FEBIO_ATTRIBUTES = (
    "lc='1'", "type='math'", "type='map'", "elem_type='UT4'", "mat='2'", "shell_normal='1'",
    "extend='repeat'", "elem_set='Part1'", "node_data='x'", "from='x.feb'", "relative='1'",
    "optional='1'", "active='0'", "unknown='1'", "bc='x'", "surface='HeldFace'",
)  # fmt: skip
FEBIO_HARMLESS = {
    "febio_spec": (
        "<Output><logfile><node_data data='ux'/></logfile></Output>", "<Constraints/>",
        "<Globals><Constants><T>298</T><R>8.3e-6</R><Fc>9.6e-5</Fc></Constants></Globals>",
        "<!-- a comment -->", "<Step/>", "<Step><step id='1' name='s'/></Step>",
    ),
    "Control": (
        "<adaptor_re_solve>0</adaptor_re_solve>", "<max_refs>25</max_refs>", "<title>t</title>",
        "<plot_level>PLOT_FINAL</plot_level>",
        "<time_stepper><dtmin>0.01</dtmin><dtmax lc='1'>0.1</dtmax></time_stepper>",
        "<solver type='solid'><dtol>0.001</dtol><qn_method type='BFGS'/></solver>",
    ),
    "Mesh": (
        "<ElementSet name='e'>1, 2</ElementSet>", "<PartList name='p'>Part1</PartList>",
        "<NodeSet name='more'>1</NodeSet>",
    ),
    "Module": ("<units>mm-N-s</units>",),
}  # fmt: skip


@st.composite
def specs(draw):
    """Text of a .feb file, and whether its additions change what is solved."""
    loads = PRESSED + bars.WEIGHED["4.0"]
    text = bars.febio(brick_box((1, 1, 1), bars.SIZE), loads=loads)
    text = text.replace('<Module type="solid"/>', '<Module type="solid"></Module>')
    text = text.replace('mat="Tissue"/>', 'mat="Tissue"></SolidDomain>')
    changes = False
    for _ in range(draw(st.integers(1, 2))):
        kind = draw(st.integers(0, 2))
        tables = {0: FEBIO_CHANGES, 1: FEBIO_HARMLESS, 2: FEBIO_CHANGES}
        tag = draw(st.sampled_from(list(tables[kind])))
        changes = changes or kind != 1
        if kind == 2:
            added = draw(st.sampled_from(FEBIO_ATTRIBUTES))
            text = re.sub(rf"<{tag}(?=[ >])", f"<{tag} {added}", text, count=1)
        else:
            added = draw(st.sampled_from(tables[kind][tag]))
            text = text.replace(f"</{tag}>", f"{added}</{tag}>", 1)
    return text, changes


PRESSED = bars.PRESSED.replace(' lc="1"', "")


def refused_or_unchanged(folder, spec):
    text, changes = spec
    path = folder / "model.feb"
    path.write_text(text)
    case = imported(path, UnitSystem.MILLIMETRE_NEWTON)
    assert not (changes and case is not None), text
    assume(case is not None)
    path.write_text(
        bars.febio(brick_box((1, 1, 1), bars.SIZE), loads=PRESSED + bars.WEIGHED["4.0"])
    )
    plain = imported(path, UnitSystem.MILLIMETRE_NEWTON).problem
    assert bars.apart(plain, case.problem) == 0.0


@pytest.mark.long
@FEW
@given(spec=specs())
def test_a_feb_is_refused_or_is_what_it_was_without_its_additions(tmp_path_factory, spec):
    refused_or_unchanged(tmp_path_factory.mktemp("feb"), spec)


@pytest.mark.nightly
@pytest.mark.timeout(0)
@MANY
@given(spec=specs())
def test_many_febs_are_refused_or_are_what_they_were(tmp_path_factory, spec):
    refused_or_unchanged(tmp_path_factory.mktemp("feb"), spec)
