"""MuJoCo models written by hand, and by MuJoCo; and MuJoCo's own state of rest.

By the XML reference of mujoco.readthedocs.io: flexcomp, flexcomp/pin, flex, elasticity.
"""

import bars
import numpy as np
import pytest

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import BodyForce, Support
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.importing import ImportRefusedError, UnitSystem

SI = UnitSystem.METRE_NEWTON


def beam():
    return brick_box((4, 2, 2), (0.2, 0.05, 0.05), ragged=0.2)


def flat(values):
    return " ".join(repr(v) for v in np.ravel(values).tolist())


def model(mesh, pins, *, mass=0.5, young=2e4):
    return f"""<mujoco model="beam">
  <option timestep="0.001" gravity="0 0 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <light pos="0 0 3"/>
    <flexcomp name="beam" type="direct" dim="3" mass="{mass}" radius="0.001"
        point="{flat(mesh.points)}"
        element="{flat(mesh.cells)}">
      <elasticity young="{young!r}" poisson="0.3" damping="0.01"/>
      <contact selfcollide="none"/>
      <pin id="{flat(pins)}"/>
    </flexcomp>
  </worldbody>
</mujoco>
"""


def pinned(mesh):
    return np.flatnonzero(mesh.points[:, 0] == 0.0)


def test_a_pinned_beam_rests_under_its_weight(bring):
    mesh = beam()
    case, imported = bring(model(mesh, pinned(mesh)), ".xml", SI)
    found = case.problem
    assert found.material.law is Law.SAINT_VENANT_KIRCHHOFF
    assert found.material.density == pytest.approx(0.5 / mesh.volume, rel=1e-12)
    fixed = mesh.boundary_facets[np.isin(mesh.boundary_facets, pinned(mesh)).all(axis=1)]
    ours = Problem(
        mesh,
        Material(2e4, 0.3, 0.5 / mesh.volume),
        (Support(pinned(mesh), fixed),),
        (BodyForce((0.0, 0.0, -9.81 * 0.5 / mesh.volume)),),
    )
    apart = solve_static(ours).displacement - solve_static(found).displacement
    assert np.abs(apart).max() < 1e-10 * np.abs(solve_static(ours).displacement).max()
    assert any("state of rest" in line for line in imported.notes)
    assert any("spreads its mass evenly" in line for line in imported.notes)


def test_single_points_and_cells_the_other_way_round(bring):
    mesh = beam()
    points = [0, 4, 8, 40]
    turned = TetMesh(mesh.points, mesh.cells)
    text = model(turned, points).replace(flat(mesh.cells), flat(mesh.cells[:, [0, 2, 1, 3]]))
    case, _ = bring(text, ".xml", SI)
    (support,) = case.problem.supports
    assert sorted(support.points.tolist()) == points
    assert len(support.facets) == 0


def test_mujoco_solves_its_own_file_the_same(bring, tmp_path, mujoco):
    # Of a single cell each point has the same share by volume too.
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.03, 0.03, 0.1]], dtype=np.float64)
    one = TetMesh(points, [[0, 1, 2, 3]])
    case, _ = bring(model(one, [0, 1, 2], mass=0.4, young=5e3), ".xml", SI)
    found = mujoco.rest(tmp_path / "model.xml")
    theirs, written = np.array(found["moved"]), found["written"]
    ours = solve_static(case.problem).displacement
    assert np.abs(ours).max() > 1e-3 * 0.1
    assert np.abs(ours - theirs).max() <= 1e-6 * np.abs(theirs).max()
    # Written out with six digits.
    again, _ = bring(written, ".xml", SI)
    order = [int(np.abs(again.problem.mesh.points - p).sum(axis=1).argmin()) for p in points]
    read = solve_static(again.problem).displacement[order]
    assert np.abs(ours - read).max() <= 1e-4 * np.abs(ours).max()


WRITTEN = """<mujoco><worldbody>
<body name="b3" pos="0 0 1"><inertial pos="0 0 0" mass="0.1" diaginertia="1e-6 1e-6 1e-6"/>
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide"/></body>
</worldbody><deformable>
<flex name="one" dim="3" body="world world world b3" vertex="0 0 0 1 0 0 0 1 0 0 0 0"
 element="0 1 2 3"><elasticity young="1e4" poisson="0.3"/></flex></deformable></mujoco>"""


def test_a_model_that_was_written_out(bring):
    case, _ = bring(WRITTEN, ".xml", SI)
    assert case.problem.mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert case.problem.material.density == pytest.approx(0.4 * 6.0)
    assert sorted(case.problem.supports[0].points.tolist()) == [0, 1, 2]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('body="world world world b3"', 'body="world world world b4"', "no body 'b4'"),
        ('<joint type="slide"/></body>', "</body>", "slides along x, y and z"),
        ('<joint type="slide"/></body>', '<joint type="ball"/></body>', "a joint that is no slide"),
        ('<joint type="slide"/>', '<joint type="slide" stiffness="3"/>', "<joint stiffness=...>"),
        ('name="b3" pos', 'name="b3" quat="0 1 0 0" pos', "<body quat=...>"),
        ("</worldbody>", '<body name="c"><inertial mass="1"/></body></worldbody>', "slides along"),
        ("0 0 0 1 0 0 0 1 0 0 0 0", "0 0 0 1 0 0", "4 bodies and 2 vertices"),
        (
            "<deformable>",
            "<equality><weld/></equality><deformable>",
            "<weld> in <equality> is not known",
        ),
        ("<deformable>", '<actuator><motor joint="j"/></actuator><deformable>', "<actuator>"),
    ],
)
def test_bodies_that_do_more_than_slide_are_refused(bring, old, new, says):
    assert old in WRITTEN
    with pytest.raises(ImportRefusedError, match=says):
        bring(WRITTEN.replace(old, new, 1), ".xml", SI)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("<mujoco model", "<robot model", "mismatched tag"),
        ("<worldbody>", '<worldbody><geom type="plane"/>', "<geom> in <worldbody> is not known"),
        ("<worldbody>", '<worldbody><body name="b"/>', "<body> beside the flexcomp"),
        ("<worldbody>", '<include file="x.xml"/><worldbody>', "<include>"),
        ('dim="3"', 'dim="2"', "a flex that is no solid"),
        ('type="direct"', 'type="grid" count="3 3 3"', "mj_saveLastXML"),
        ('type="direct"', 'type="direct" euler="0 0 90"', "<flexcomp euler=...>: write the model"),
        ('type="direct"', 'type="direct" dof="trilinear"', "not every point moves by itself"),
        ("<elasticity", '<edge stiffness="5"/><elasticity', "springs or constraints"),
        ("<elasticity", '<edge equality="true"/><elasticity', "springs or constraints"),
        ("<elasticity", '<plugin plugin="x"/><elasticity', "<plugin>"),
        ('young="20000.0"', 'young="0"', "above 0 is needed"),
        ('<pin id="', '<pin id="99 ', "<pin>: no point 99"),
        ('<pin id="', '<pin range="3 99" id="', "no points 3 to 99"),
        ('element="', 'element="0 1 ', "four numbers a tetrahedron"),
        ('element="', 'element="0 1 2 99 ', "names a point outside 0..44"),
        ('mass="0.5"', 'mass="-1"', "a body of mass -1"),
        ('contact="disable"', 'passive="disable"', "<flag passive=...> is not known"),
    ],
)
def test_what_a_case_cannot_say_is_refused(bring, old, new, says):
    text = model(beam(), [0])
    assert old in text
    with pytest.raises(ImportRefusedError, match=says):
        bring(text.replace(old, new, 1), ".xml", SI)


def test_an_edge_without_springs_says_nothing(bring):
    mesh = beam()
    text = model(mesh, pinned(mesh))
    plain, _ = bring(text, ".xml", SI)
    edged, _ = bring(text.replace("<elasticity", '<edge equality="false"/><elasticity'), ".xml", SI)
    assert edged.problem.material == plain.problem.material


def test_without_enough_pins_it_floats(bring, tmp_path):
    with pytest.raises(InputError, match="is not held enough"):
        bring(model(beam(), [0]), ".xml", SI)
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


def test_a_gmsh_file_beside_it(bring, tmp_path):
    from palpate.meshes.files import write_mesh

    mesh = bars.bar()
    write_mesh(tmp_path / "bar.msh", mesh)
    text = model(mesh, pinned(mesh)).replace('type="direct"', 'type="gmsh" file="bar.msh"')
    text = text.replace("point=", "rgba=", 1).replace("element=", "material=", 1)
    case, _ = bring(text, ".xml", SI)
    assert case.problem.mesh.num_cells == mesh.num_cells
    for name, says in (("../bar.msh", "outside the case's folder"), ("no.msh", "no such file")):
        with pytest.raises(ImportRefusedError, match=says):
            bring(text.replace("bar.msh", name), ".xml", SI)
