"""Stand-ins for programs that cannot be installed here: they read what those read, strictly.

FEBio by its user's manual and its readers (github.com/febiosoftware/FEBio, FEBioXML/*4.cpp), SOFA
by the names of its components' data (github.com/sofa-framework/sofa) and SofaPython3's controllers.
What they read is solved by fastsim; the log, the record and the calls are as those programs make
them.
"""

import stat
import sys
import types
import xml.etree.ElementTree as ET
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.meshes.tet_mesh import TetMesh


def install(folder, name):
    """Put a stand-in of this name into a folder, which goes on the path."""
    path = Path(folder, name)
    call = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})"
    call += f"; import programs_of_others; programs_of_others.{name}()"
    path.write_text(f"#!{sys.executable}\n{call}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def solved(points, cells, material, fixed, moved, force, strain=Strain.GREEN):
    """Displacement of the points by fastsim, from arrays alone."""
    supports = [
        Support(
            np.array([point]), np.zeros((0, 3), dtype=np.int64), tuple(map(bool, fixed[point])),
            tuple(np.where(fixed[point], moved[point], 0.0)),
        )
        for point in np.flatnonzero(fixed.any(axis=1))
    ]  # fmt: skip
    pushed = np.flatnonzero(force.any(axis=1))
    loads = (PointForce(pushed, force[pushed]),) if len(pushed) else ()
    problem = Problem(TetMesh(points, cells), material, tuple(supports), loads)
    return solve_static(problem, strain=strain).displacement


# ------------------------------------------------------------------------------------------- FEBio
_SECTIONS = [
    "Module", "Control", "Material", "Mesh", "MeshDomains", "Boundary", "Loads", "LoadData",
    "Output",
]  # fmt: skip
_MATERIALS = {"isotropic elastic": Law.SAINT_VENANT_KIRCHHOFF, "neo-Hookean": Law.NEO_HOOKEAN}


def febio4():
    """`febio4 -i MODEL -o LOG`."""
    words = sys.argv[1:]
    model, log = Path(words[words.index("-i") + 1]), Path(words[words.index("-o") + 1])
    root = ET.parse(model).getroot()
    assert (root.tag, root.attrib) == ("febio_spec", {"version": "4.0"})
    assert [section.tag for section in root] == _SECTIONS
    ids, points = _numbered(root.findall("Mesh/Nodes/node"), float)
    (block,) = root.findall("Mesh/Elements")
    assert block.get("type") == "tet4"
    _, cells = _numbered(block.findall("elem"), int)
    row = {number: k for k, number in enumerate(ids)}
    cells = np.array([[row[number] for number in cell] for cell in cells])
    points = np.array(points)
    assert root.find("MeshDomains/SolidDomain").get("name") == block.get("name")
    sets = {
        one.get("name"): [row[int(word)] for word in one.text.split(",")]
        for one in root.findall("Mesh/NodeSet")
    }
    (material,) = root.findall("Material/material")
    E, nu, density = (float(material.findtext(name)) for name in ("E", "v", "density"))
    material = Material(E, nu, density, _MATERIALS[material.get("type")])
    fixed, moved = np.zeros(points.shape, dtype=bool), np.zeros(points.shape)
    for bc in root.findall("Boundary/bc"):
        nodes = sets[bc.get("node_set")]
        if bc.get("type") == "zero displacement":
            for axis, name in enumerate("xyz"):
                fixed[nodes, axis] |= bc.findtext(f"{name}_dof", "0") == "1"
        else:
            assert bc.get("type") == "prescribed displacement"
            axis = "xyz".index(bc.findtext("dof"))
            fixed[nodes, axis] = True
            moved[nodes, axis] = float(bc.findtext("value")) * _at_end(root, bc.find("value"))
    force = np.zeros(points.shape)
    for load in root.findall("Loads/nodal_load"):
        assert load.get("type") == "nodal_force"
        value = np.array([float(word) for word in load.findtext("value").split(",")])
        force[sets[load.get("node_set")]] += value * _at_end(root, load.find("value"))
    (record,) = root.findall("Output/logfile/node_data")
    assert record.get("data") == "ux;uy;uz"
    displacement = solved(points, cells, material, fixed, moved, force)
    steps = int(root.findtext("Control/time_steps"))
    lines = []
    for step in range(1, steps + 1):
        part = step / steps
        lines += [f"*Step  = {step}", f"*Time  = {part:.9g}", f"*Data  = {record.get('data')}"]
        for number, u in zip(ids, part * displacement, strict=True):
            lines.append(record.get("delim", " ").join([str(number), *(f"{x:.12g}" for x in u)]))
    model.with_name(record.get("file")).write_text("\n".join([*lines, ""]), encoding="utf-8")
    log.write_text(
        "  version 4.9.0\n\tTotal number of equilibrium iterations ............ : 12\n\n"
        "\n N O R M A L   T E R M I N A T I O N\n\n",
        encoding="utf-8",
    )


def _numbered(elements, kind):
    """Numbers, which have to increase, and what stands in each."""
    ids = [int(one.get("id")) for one in elements]
    assert ids == sorted(set(ids))
    return ids, [[kind(word) for word in one.text.split(",")] for one in elements]


def _at_end(root, element):
    """What the load curve of an element is at the end of the step."""
    steps, size = (float(root.findtext(f"Control/{name}")) for name in ("time_steps", "step_size"))
    (curve,) = (
        one
        for one in root.findall("LoadData/load_controller")
        if one.get("id") == element.get("lc")
    )
    times, values = zip(
        *([float(word) for word in pt.text.split(",")] for pt in curve.findall("points/pt")),
        strict=True,
    )
    return np.interp(steps * size, times, values)


# -------------------------------------------------------------------------------------------- SOFA
# Components, the plugin of each, and the data that the adapter may set.
_COMPONENTS = {
    "RequiredPlugin": ("", "pluginName"),
    "DefaultAnimationLoop": ("", ""),
    "NewtonRaphsonSolver": (
        "ODESolver.Backward",
        "name maxNbIterationsNewton absoluteResidualStoppingThreshold maxNbIterationsLineSearch "
        "relativeSuccessiveStoppingThreshold relativeInitialStoppingThreshold",
    ),
    "StaticSolver": ("ODESolver.Backward", "newtonSolver"),
    "EigenSimplicialLDLT": ("LinearSolver.Direct", "template"),
    "MeshTopology": ("Topology.Container.Constant", "position tetrahedra"),
    "MechanicalObject": ("StateContainer", "position rest_position"),
    "TetrahedronFEMForceField": (
        "SolidMechanics.FEM.Elastic", "youngModulus poissonRatio method",
    ),
    "TetrahedronHyperelasticityFEMForceField": (
        "SolidMechanics.FEM.HyperElastic", "materialName ParameterSet",
    ),
    "FixedProjectiveConstraint": ("Constraint.Projective", "indices"),
    "PartialFixedProjectiveConstraint": ("Constraint.Projective", "indices fixedDirections"),
    "ConstantForceField": ("MechanicalLoad", "indices forces"),
}  # fmt: skip
_SOFAS_LAWS = {
    "StVenantKirchhoff": Law.SAINT_VENANT_KIRCHHOFF,
    "NeoHookean": Law.NEO_HOOKEAN,
    "StableNeoHookean": Law.NEO_HOOKEAN_STABLE,
}


class _Data:
    def __init__(self, value):
        self.value = value

    def array(self):
        return self.value

    def getValueString(self):  # noqa: N802
        return str(self.value)

    @contextmanager
    def writeableArray(self):  # noqa: N802
        yield self.value


class _Component:
    def __init__(self, kind, data):
        self.kind, self.given = kind, data
        for name in ("position", "forces"):
            if name in data:
                setattr(self, name, _Data(np.array(data[name], dtype=float)))
        self.status = _Data("Undefined")

    def findData(self, name):  # noqa: N802
        return getattr(self, name)


class _Node:
    def __init__(self):
        self.objects, self.children = [], []

    def addObject(self, kind, **data):  # noqa: N802
        if isinstance(kind, str):
            plugin, names = _COMPONENTS[kind]
            assert data.keys() <= set(names.split()), f"{kind}: {data.keys()}"
            loaded = [one.given.get("pluginName") for one in self.root.objects]
            assert not plugin or f"Sofa.Component.{plugin}" in loaded, f"{kind}: {plugin}"
            kind = _Component(kind, data)
        self.objects.append(kind)
        return kind

    def addChild(self, _name):  # noqa: N802
        child = _Node()
        child.root = self.root
        self.children.append(child)
        return child

    def find(self, kind):
        return [one for one in self.objects if one.kind == kind]


class _Controller:
    kind, given = "Controller", types.MappingProxyType({})

    def __init__(self, *args, **kwargs):
        """SofaPython3's takes its name and hands the rest to the class derived from it."""


def runSofa():  # noqa: N802
    """`runSofa -l SofaPython3 -g batch -n STEPS SCENE`."""
    words = sys.argv[1:]
    assert words[words.index("-l") + 1] == "SofaPython3"
    assert words[words.index("-g") + 1] == "batch"
    sys.modules["Sofa"] = types.ModuleType("Sofa")
    sys.modules["Sofa"].Core = types.SimpleNamespace(Controller=_Controller)
    sys.modules["Sofa"].GetVersion = lambda: "v26.06"
    scene = {}
    exec(compile(Path(words[-1]).read_text(encoding="utf-8"), words[-1], "exec"), scene)
    root = _Node()
    root.root = root
    scene["createScene"](root)
    assert root.gravity == [0.0, 0.0, 0.0]
    (controller,) = root.find("Controller")
    for _ in range(int(words[words.index("-n") + 1])):
        controller.onAnimateBeginEvent({})
        _equilibrium(root.children[0])
        controller.onAnimateEndEvent({})


def _equilibrium(body):
    """What StaticSolver does in a step: points whose components are fixed stay where they are."""
    (state,), (topology,), (load,) = (
        body.find(kind) for kind in ("MechanicalObject", "MeshTopology", "ConstantForceField")
    )
    rest = np.array(state.given["rest_position"])
    assert rest.tolist() == topology.given["position"]
    fixed = np.zeros(rest.shape, dtype=bool)
    for one in body.find("FixedProjectiveConstraint"):
        fixed[one.given["indices"]] = True
    for one in body.find("PartialFixedProjectiveConstraint"):
        fixed[one.given["indices"]] |= np.array(one.given["fixedDirections"], dtype=bool)
    force = np.zeros(rest.shape)
    force[load.given["indices"]] = load.forces.value
    (newton,) = body.find("NewtonRaphsonSolver")
    if body.find("TetrahedronFEMForceField"):
        (field,) = body.find("TetrahedronFEMForceField")
        assert field.given["method"] == "small"
        material = Material(field.given["youngModulus"], field.given["poissonRatio"])
        strain = Strain.LINEAR
    else:
        (field,) = body.find("TetrahedronHyperelasticityFEMForceField")
        mu, lmbda = map(float, field.given["ParameterSet"].split())
        nu = lmbda / (2.0 * (lmbda + mu))
        law = _SOFAS_LAWS[field.given["materialName"]]
        material, strain = Material(2.0 * mu * (1.0 + nu), nu, law=law), Strain.GREEN
    moved = state.position.value - rest
    cells = np.array(topology.given["tetrahedra"])
    moved = solved(rest, cells, material, fixed, moved, force, strain)
    state.position.value[:] = rest + moved
    newton.status.value = "ConvergedAbsoluteResidual"
