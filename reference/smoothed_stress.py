"""Linear tetrahedra with strains averaged over edges and nodes, in UFL (see `smoothing`).

The stress S of a cell depends on the displacement of its neighbours too, so UFL is given it as a
function that is constant in each cell:

    R(u; v) = integral of F(u) S : grad v,    dR = integral of grad du S : grad v  +  B^T (dS/dE) B.
"""

from __future__ import annotations

from typing import Any

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Strain
from palpate.meshes.tet_mesh import signed_volumes
from palpate.reference import fenicsx
from palpate.reference.fenicsx import PETSc, fem, ufl
from palpate.reference.kinematics import strain_tensor
from palpate.reference.mesh_transfer import TransferredSpace
from palpate.reference.smoothing import Smoothing


class SmoothedStress:
    """The stress of a displacement by averaged strains.

    Args:
        space: Displacement space of degree 1, on one rank.
        u: Displacement; its values may change.
        strain: Strain measure.
        lame: First Lamé parameter and shear modulus [Pa], functions that are constant in each cell.

    Attributes:
        stress: Second Piola-Kirchhoff stress [Pa], a function that is constant in each cell.

    Raises:
        InputError: Another degree, or more than one rank.
    """

    def __init__(
        self, space: TransferredSpace, u: Any, strain: Strain, lame: tuple[Any, Any]
    ) -> None:
        if space.degree != 1:
            raise InputError(f"degree = {space.degree}: smoothed tetrahedra are of degree 1")
        if fenicsx.COMM.size > 1:
            raise InputError("smoothed tetrahedra run on one rank; leave mpirun out")
        self._u, self._strain = u, strain
        transferred = space.transferred
        self._dx = ufl.dx(domain=transferred.mesh, metadata={"quadrature_degree": 0})
        tensors = fenicsx.cell_tensor_space(transferred.mesh)
        T, du = ufl.TestFunction(tensors), ufl.TrialFunction(space.space)
        # Each T is 1 in one component in one cell: these are the integrals V_c E_c.
        strains = ufl.inner(strain_tensor(u, strain), T) * self._dx
        self._strains = fenicsx.form(strains)
        self._strain_rates = fenicsx.form(ufl.derivative(strains, u, du))
        self._rates = fenicsx.create_matrix(self._strain_rates)
        self.stress = fem.Function(tensors)
        self._smoothing = smoothing_of(space, lame)

    def virtual_work(self, v: Any) -> Any:
        """Integral of F S : grad v, with F = I under linear strain."""
        # A factor, so that the geometric part of the tangent has a form also where it is zero.
        turns = fem.Constant(self._dx.ufl_domain(), PETSc.ScalarType(self._strain is Strain.GREEN))
        F = ufl.Identity(3) + turns * ufl.grad(self._u)
        return ufl.inner(F * self.stress, ufl.grad(v)) * self._dx

    def update(self) -> None:
        """Make the stress that of u."""
        self.stress.x.array[:] = self._smoothing.stress(fenicsx.assemble_vector(self._strains))

    def energy(self) -> float:
        """Stored energy of u [J]."""
        return self._smoothing.energy(fenicsx.assemble_vector(self._strains))

    def stiffness(self) -> Any:
        """B^T (dS/dE) B at u, a new PETSc matrix: the tangent but for its geometric part."""
        self._rates.zeroEntries()
        fenicsx.assemble_into_matrix(self._rates, self._strain_rates)
        return self._smoothing.stiffness(self._rates)


def smoothing_of(space: TransferredSpace, lame: tuple[Any, Any]) -> Smoothing:
    """The averages of a body, of strains and stresses as functions constant in each cell.

    Args:
        space: Displacement space on one rank.
        lame: First Lamé parameter and shear modulus [Pa], functions that are constant in each cell.
    """
    transferred, (lmbda, mu) = space.transferred, lame
    source, tensors = transferred.source, fenicsx.cell_tensor_space(transferred.mesh)
    return Smoothing(
        transferred.mesh,
        fenicsx.cell_dofs(tensors)[:, 0],
        fenicsx.cell_values(lmbda),
        fenicsx.cell_values(mu),
        signed_volumes(source.points, source.cells)[transferred.cell_of_cell],
    )
