"""A bar in the words of each program, written by hand from arrays, and the same as a problem."""

import numpy as np

from palpate.fastsim.statics import solve_static
from palpate.meshes.boundary_conditions import Support
from palpate.meshes.bricks import brick_box, side
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.tet_mesh import TetMesh

# mm, N, MPa.
SIZE = (40.0, 10.0, 10.0)


def bar():
    """Four by two by two bricks, their inner points moved."""
    return brick_box((4, 2, 2), SIZE, ragged=0.2)


def fixed_end(mesh):
    """Facets of the end x = 0."""
    return side(mesh, 0, 0.0)


def pulled(mesh):
    """Facets of the end x = 40."""
    return side(mesh, 0, SIZE[0])


def rows(numbers, per_line=8):
    """Whole numbers separated by commas, some to a line."""
    words = [str(n) for n in numbers]
    starts = range(0, len(words), per_line)
    return ",\n".join(", ".join(words[k : k + per_line]) for k in starts)


def positions(points):
    """Coordinates with all their digits."""
    return [", ".join(repr(float(x)) for x in point) for point in np.asarray(points)]


def quadratic(mesh):
    """Points with a middle node on each edge, and cells of ten nodes: 5 to 10 by the manuals."""
    points = [tuple(p) for p in mesh.points.tolist()]
    number = {}
    cells = []
    for cell in mesh.cells.tolist():
        nodes = list(cell)
        for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)):
            edge = (min(cell[a], cell[b]), max(cell[a], cell[b]))
            if edge not in number:
                number[edge] = len(points)
                ends = mesh.points[list(edge)]
                points.append(tuple(ends.mean(axis=0).tolist()))
            nodes.append(number[edge])
        cells.append(nodes)
    return np.array(points), cells


def one_based(items):
    """Rows of numbers from one."""
    found = (np.asarray(items) + 1).tolist()
    return found


# The same in the words of each version: chapters "Boundary Section", "Loads Section" and
# "LoadData Section" of the user's manuals of FEBio 2.9, 3.6 and 4.0.
FIXED = {
    "2.5": '<fix bc="x,y,z" node_set="Held"/>',
    "3.0": '<bc type="fix" node_set="Held"><dofs>x,y,z</dofs></bc>',
    "4.0": '<bc name="root" type="zero displacement" node_set="Held">'
    "<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof></bc>",
}
MOVED = {
    "2.5": '<prescribe bc="z" node_set="End"><scale lc="1">6</scale><relative>0</relative>'
    "</prescribe>",
    "3.0": '<bc type="prescribe" node_set="End"><dof>z</dof><scale lc="1">6</scale>'
    "<relative>0</relative></bc>",
    "4.0": '<bc type="prescribed displacement" node_set="End"><dof>z</dof>'
    '<value lc="1">6</value><relative>0</relative></bc>',
}
PRESSED = (
    '<surface_load type="pressure" surface="EndFace"><pressure lc="1">-0.004</pressure>'
    "<linear>0</linear><symmetric_stiffness>1</symmetric_stiffness></surface_load>"
)
WEIGHED = {
    "2.5": '<body_load type="const"><x lc="1">0</x><y>0</y><z lc="1">9810</z></body_load>',
    "3.0": '<body_load type="const"><z lc="1">9810</z></body_load>',
    "4.0": '<body_load type="body force"><force lc="1">0,0,9810</force></body_load>',
}
# At the end, t = 1, it is worth a half.
CURVE = {
    "2.5": '<LoadData><loadcurve id="1" type="linear"><point>0,0</point><point>2,1</point>'
    "</loadcurve></LoadData>",
    "3.0": '<LoadData><load_controller id="1" type="loadcurve"><interpolate>LINEAR</interpolate>'
    "<points><point>0,0</point><point>2,1</point></points></load_controller></LoadData>",
}
CURVE["4.0"] = CURVE["3.0"].replace("point>", "pt>").replace("pts>", "points>")


def febio(
    mesh=None,
    *,
    version="4.0",
    material="<density>1e-9</density><E>0.1</E><v>0.4</v>",
    law="neo-Hookean",
    boundary=None,
    loads="",
    cells=None,
    points=None,
):
    """A .feb file by that version's manual; sets Held and End of nodes, and of their facets."""
    mesh = bar() if mesh is None else mesh
    boundary = FIXED[version] if boundary is None else boundary
    is_old = version == "2.5"
    kind = "tet4" if cells is None else "tet10"
    used = one_based(mesh.cells if cells is None else cells)
    nodes = "".join(
        f'<node id="{k}">{position}</node>\n'
        for k, position in enumerate(positions(mesh.points if points is None else points), 1)
    )
    elements = "".join(
        f'<elem id="{k}">{", ".join(map(str, row))}</elem>\n' for k, row in enumerate(used, 1)
    )
    sets = ""
    for name, facets in (("Held", fixed_end(mesh)), ("End", pulled(mesh))):
        numbers = sorted({n for row in one_based(facets) for n in row})
        if version == "4.0":
            sets += f'<NodeSet name="{name}">{", ".join(map(str, numbers))}</NodeSet>\n'
        else:
            listed = "".join(f'<n id="{n}"/>' for n in numbers)
            listed = listed.replace("<n ", "<node ") if is_old else listed
            sets += f'<NodeSet name="{name}">{listed}</NodeSet>\n'
        faces = "".join(
            f'<tri3 id="{k}">{a}, {b}, {c}</tri3>\n'
            for k, (a, b, c) in enumerate(one_based(facets), 1)
        )
        sets += f'<Surface name="{name}Face">{faces}</Surface>\n'
    mat = ' mat="1"' if is_old else ""
    section = "Geometry" if is_old else "Mesh"
    domains = (
        "" if is_old else '<MeshDomains><SolidDomain name="Part1" mat="Tissue"/></MeshDomains>'
    )
    return f"""<?xml version="1.0" encoding="ISO-8859-1"?>
<febio_spec version="{version}">
<Module type="solid"/>
<Control><analysis>STATIC</analysis><time_steps>10</time_steps><step_size>0.1</step_size></Control>
<Material><material id="1" name="Tissue" type="{law}">{material}</material></Material>
<{section}><Nodes name="Object1">
{nodes}</Nodes>
<Elements type="{kind}"{mat} name="Part1">
{elements}</Elements>
{sets}</{section}>
{domains}
<Boundary>{boundary}</Boundary>
<Loads>{loads}</Loads>
{CURVE[version]}
<Output><plotfile type="febio"><var type="displacement"/></plotfile></Output>
</febio_spec>
"""


def abaqus(
    mesh=None,
    *,
    material="*ELASTIC\n0.1, 0.3",
    step="*STEP, NLGEOM",
    before="",
    acts="*CLOAD\n45, 3, 1e-4",
    cells=None,
    points=None,
):
    """An .inp file with sets HELD, END, ALL and the surface ENDFACE; x = 0 is fixed."""
    mesh = bar() if mesh is None else mesh
    used = one_based(mesh.cells if cells is None else cells)
    shown = [
        f"{k}, {position}"
        for k, position in enumerate(positions(mesh.points if points is None else points), 1)
    ]
    lines = ["*HEADING", "A bar, by hand", "** a comment", "*NODE, NSET=ALLNODES", *shown]
    lines += [f"*ELEMENT, TYPE={'C3D4' if cells is None else 'C3D10'}, ELSET=ALL"]
    lines += [f"{k}, " + ", ".join(map(str, row)) for k, row in enumerate(used, 1)]
    for name, facets in (("HELD", fixed_end(mesh)), ("END", pulled(mesh))):
        numbers = sorted({n for row in one_based(facets) for n in row})
        lines += [f"*NSET, NSET={name}", rows(numbers)]
    lines += ["*SURFACE, NAME=ENDFACE", *faces_of(mesh, pulled(mesh))]
    lines += ["*MATERIAL, NAME=TISSUE", material, "*SOLID SECTION, ELSET=ALL, MATERIAL=TISSUE"]
    lines += ["*BOUNDARY", "HELD, 1, 3", before, step, "*STATIC", "0.25, 1.", acts]
    lines += ["*NODE PRINT, NSET=ALLNODES", "U", "*END STEP", ""]
    return "\n".join(line for line in lines if line or line == lines[-1])


def faces_of(mesh, facets):
    """Lines of a *SURFACE: the cell behind each facet, and which face of it that is."""
    faces = {1: (0, 1, 2), 2: (0, 1, 3), 3: (1, 2, 3), 4: (0, 2, 3)}
    found = {
        tuple(sorted(cell[list(corners)])): f"{k}, S{face}"
        for k, cell in enumerate(mesh.cells, 1)
        for face, corners in faces.items()
    }
    return [found[tuple(sorted(facet))] for facet in facets]


def native(material, *loads, more=()):
    """The bar as a problem in metres, fixed at x = 0."""
    mesh = bar()
    end = fixed_end(mesh)
    metres = TetMesh(1e-3 * mesh.points, mesh.cells)
    return Problem(metres, material, (Support(np.unique(end), end), *more), loads)


def apart(problem, other, strain=Strain.GREEN):
    """Largest difference of their displacements at equilibrium, of the largest."""
    ours = solve_static(problem, strain=strain).displacement
    theirs = solve_static(other, strain=strain).displacement
    assert np.abs(ours).max() > 1e-4 * np.ptp(problem.mesh.points, axis=0).max()
    assert np.allclose(problem.mesh.points, other.mesh.points, rtol=1e-12, atol=0.0)
    return float(np.abs(ours - theirs).max() / np.abs(ours).max())
