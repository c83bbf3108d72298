"""FEBio models written by hand, by the sections of its user's manual, give the native problem."""

import bars
import numpy as np
import pytest

from palpate.meshes.boundary_conditions import BodyForce, Pressure, Support, Traction
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material
from palpate.validation.importing import ImportRefusedError

VERSIONS = ("2.5", "3.0", "4.0")
PRESSED = bars.PRESSED


@pytest.mark.parametrize("version", VERSIONS)
def test_a_neo_hookean_bar_under_pressure_and_weight(bring, version):
    text = bars.febio(version=version, loads=PRESSED + bars.WEIGHED[version])
    case, imported = bring(text, ".feb")
    material = Material(100e3, 0.4, 1000.0, Law.NEO_HOOKEAN)
    mesh = bars.bar()
    loads = Pressure(bars.pulled(mesh), -2e3), BodyForce((0.0, 0.0, -1000.0 * 9.81 / 2.0))
    assert case.problem.material == material
    assert bars.apart(bars.native(material, *loads), case.problem) < 1e-10
    assert not imported.notes
    left_out = [line.split(" ", 2)[2] for line in imported.ignored]
    assert left_out == ["<symmetric_stiffness>", "<Output>"]


@pytest.mark.parametrize("version", VERSIONS)
def test_a_moved_end_of_isotropic_elastic(bring, version):
    text = bars.febio(
        version=version, boundary=bars.FIXED[version] + bars.MOVED[version],
        law="isotropic elastic", material="<E>0.1</E><v>0.3</v>",
    )  # fmt: skip
    case, imported = bring(text, ".feb")
    mesh = bars.bar()
    end = bars.pulled(mesh)
    moved = Support(np.unique(end), end, (False, False, True), (0.0, 0.0, 3e-3))
    material = Material(100e3, 0.3)
    assert bars.apart(bars.native(material, more=(moved,)), case.problem) < 1e-10
    assert any("no density" in line for line in imported.notes)


@pytest.mark.parametrize(
    ("model", "law"),
    [
        ("<pressure_model>Abaqus</pressure_model>", Law.MOONEY_RIVLIN),
        ("<pressure_model>default</pressure_model>", Law.MOONEY_RIVLIN_LOG),
        ("", Law.MOONEY_RIVLIN_LOG),
    ],
)
def test_mooney_rivlin_with_both_pressure_models_and_dead_loads(bring, model, law):
    material = f"<density>1e-9</density><c1>0.001</c1><c2>0.0005</c2><k>0.05</k>{model}"
    loads = (
        '<surface_load type="traction" surface="EndFace"><scale lc="1">2</scale>'
        "<traction>0,0,2e-4</traction><linear>1</linear></surface_load>"
        '<surface_load type="pressure" surface="EndFace"><pressure>-0.001</pressure>'
        "<linear>1</linear></surface_load>"
    )
    text = bars.febio(law="Mooney-Rivlin", material=material, loads=loads)
    case, _ = bring(text, ".feb")
    ours = Material.mooney_rivlin(c10=1e3, c01=500.0, bulk_modulus=50e3, law=law)
    end = bars.pulled(bars.bar())
    loads_here = Traction(end, (0.0, 0.0, 200.0)), Traction(end, (1e3, 0.0, 0.0))
    assert bars.apart(bars.native(ours, *loads_here), case.problem) < 1e-10


def test_a_facet_given_the_other_way_round_is_pulled(bring):
    text = bars.febio(loads=PRESSED.replace(' lc="1"', ""))
    a, b, c = bars.one_based(bars.pulled(bars.bar()))[0]
    assert f"{a}, {b}, {c}</tri3>" in text
    case, _ = bring(text.replace(f">{a}, {b}, {c}</tri3>", f">{a}, {c}, {b}</tri3>"), ".feb")
    found = {load.pressure: len(load.facets) for load in case.problem.loads}
    assert found == {-4000.0: 7, 4000.0: 1}


def test_quadratic_cells_are_read_by_their_corners(bring):
    mesh = bars.bar()
    points, cells = bars.quadratic(mesh)
    text = bars.febio(loads=PRESSED, points=points, cells=cells)
    case, imported = bring(text, ".feb")
    material = Material(100e3, 0.4, 1000.0, Law.NEO_HOOKEAN)
    problem = bars.native(material, Pressure(bars.pulled(mesh), -2e3))
    assert bars.apart(problem, case.problem) < 1e-10
    assert any("96 quadratic tetrahedra" in line for line in imported.notes)
    assert not any("curved" in line for line in imported.notes)
    points[-1] += 0.5
    text = bars.febio(loads=PRESSED, points=points, cells=cells)
    assert any("are curved, by up to" in line for line in bring(text, ".feb")[1].notes)


def test_two_materials_are_a_body_and_an_inclusion(bring):
    text = bars.febio(loads=PRESSED)
    stiff = '<material id="2" name="Stiff" type="neo-Hookean"><E>0.05</E><v>0.4</v></material>'
    text = text.replace("</Material>", f"{stiff}</Material>")
    text = text.replace(
        '<elem id="81">', '</Elements><Elements type="tet4" name="P2"><elem id="81">'
    )
    text = text.replace("</MeshDomains>", '<SolidDomain name="P2" mat="Stiff"/></MeshDomains>')
    (part,) = bring(text, ".feb")[0].problem.inclusions
    assert part.material.youngs_modulus == pytest.approx(50e3)
    assert len(part.cells) == 16


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('version="4.0"', 'version="1.2"', r"model\.feb:2: format version '1.2'; known are 2.5"),
        ("<febio_spec", "<?x?><!DOCTYPE a><febio_spec", "document type"),
        ('type="solid"', 'type="biphasic"', 'module type="biphasic"'),
        ("STATIC", "DYNAMIC", "analysis 'dynamic'"),
        ('"neo-Hookean"', '"Ogden"', "material 'Ogden'; known here are neo-Hookean"),
        ("<v>0.4</v>", "", "needs <v>"),
        ("<v>0.4</v>", "<v>0.4</v><k>3</k>", "<k> in <material> is not known"),
        ("<E>0.1", '<E type="map">0.1', "<E> varies in space or time"),
        ("<E>0.1", '<E type="array">0.1', "<E> varies in space or time"),
        ("<E>0.1", "<E>stiff", "'stiff' is no number"),
        ('type="tet4"', 'type="hex20"', "elements of type 'hex20'; a case has tetrahedra"),
        ("SolidDomain", "ShellDomain", "no <SolidDomain> for the elements 'Part1'"),
        ('<node id="1">', '<node id="">', "<node id=...>: '' is no whole number"),
        ('mat="Tissue"', 'mat="Bone"', "no material 'Bone' .known: "),
        ("<Loads>", "<Contact><contact/></Contact><Loads>", "<contact> in <Contact>"),
        ("<Loads>", "<Vibrations/><Loads>", "<Vibrations> in <febio_spec> is not known"),
        ("<Loads>", '<Loads from="x.feb">', "stands in another file"),
        ("<Loads>", '<Step><step id="1"/><step id="2"/></Step><Loads>', "a second step"),
        ('node_set="Held"', 'node_set="Nobody"', "no node set 'Nobody'"),
        ('"zero displacement"', '"rigid"', "boundary condition 'rigid'"),
        ('surface="EndFace"', 'surface="Side"', "no surface 'Side'"),
        ('type="pressure"', 'type="bearing load"', "surface load 'bearing load'"),
        ("</linear>", "</linear><shell_bottom>1</shell_bottom>", "<shell_bottom>: a case is of"),
        ('lc="1"', 'lc="7"', "no load curve 7"),
        ("LINEAR", "SMOOTH", "a smooth curve between its points"),
        ("pt>2,1<", "pt>0.5,1</pt><pt>0.7<", "points of two numbers"),
        ("</Loads>", '<body_load type="centrifugal"/></Loads>', "body load 'centrifugal'"),
        ("</Loads>", '<edge_load type="x"/></Loads>', "<edge_load> in <Loads>"),
        ("</febio_spec>", "", "cannot be read as XML"),
    ],
)  # fmt: skip
def test_what_a_case_cannot_say_is_refused(bring, old, new, says):
    text = bars.febio(loads=PRESSED)
    assert old in text
    with pytest.raises(ImportRefusedError, match=says) as caught:
        bring(text.replace(old, new, 1), ".feb")
    assert caught.value.path.endswith("model.feb")


@pytest.mark.parametrize(
    ("law", "material", "loads", "says"),
    [
        (
            "Mooney-Rivlin",
            "<c1>1</c1><c2>0</c2><k>9</k><pressure_model>Liu</pressure_model>",
            "",
            r"known here are default, U = k/2 \(ln J\)\^2",
        ),
        (
            "neo-Hookean", "<E>1</E><v>0.3</v>",
            '<surface_load type="traction" surface="EndFace"><traction>0,0,1</traction>'
            "</surface_load>",
            "a traction by deformed area",
        ),
        ("neo-Hookean", "<E>1</E><v>0.3</v>", bars.WEIGHED["4.0"], "no density"),
    ],
)  # fmt: skip
def test_what_is_nearly_the_same_is_not_taken_for_it(bring, law, material, loads, says):
    text = bars.febio(law=law, material=material, loads=loads)
    with pytest.raises(ImportRefusedError, match=says):
        bring(text, ".feb")
