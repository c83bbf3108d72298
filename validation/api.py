"""The front door: what `import palpate` offers, in SI units.

What is plain data (a mesh, a material, what is held and pushed, a problem) comes from
`palpate.meshes`; the verbs do what the command line does. Nothing slow is loaded before a verb
that needs it is called.
"""

from __future__ import annotations

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import BodyForce, PointForce, Pressure, Support, Traction
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.result import Formulation
from palpate.validation.solving import Simulator, simulate, solve
from palpate.validation.states import (
    CandidateFailedError,
    Elements,
    Method,
    State,
    Trajectory,
    Verdict,
)
from palpate.validation.verbs import audit, compare, export, judge, load_case, mesh

__all__ = [
    "AnchorPath",
    "BodyForce",
    "BoxShape",
    "CandidateFailedError",
    "CapsuleShape",
    "Element",
    "Elements",
    "ForceDrive",
    "Formulation",
    "Inclusion",
    "InputError",
    "Law",
    "Material",
    "Method",
    "PlaneShape",
    "PointForce",
    "Pressure",
    "Problem",
    "ReferenceFailedError",
    "ReferenceUnavailableError",
    "RepairChoices",
    "RigidTool",
    "Simulator",
    "SphereShape",
    "Spring",
    "State",
    "Strain",
    "Support",
    "SurfaceShape",
    "TabularAmplitude",
    "TetMesh",
    "TimeSpan",
    "ToolPath",
    "Traction",
    "Trajectory",
    "TriSurface",
    "Verdict",
    "audit",
    "compare",
    "export",
    "judge",
    "load_case",
    "mesh",
    "simulate",
    "solve",
]
