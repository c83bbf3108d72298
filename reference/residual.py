"""Internal forces from UFL, node for node."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.meshes.arrays import Points
from palpate.meshes.problem import Element, Inclusion, Material, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.reference.discrete_problem import ElasticBody
from palpate.reference.mesh_transfer import create_space, transfer


def internal_force(
    mesh: TetMesh,
    displacement: Points,
    *,
    material: Material,
    strain: Strain = Strain.GREEN,
    degree: int = 1,
    inclusions: Sequence[Inclusion] = (),
    element: Element = Element.LINEAR,
) -> Points:
    """Assemble nodal internal forces, f_a = integral of P grad N_a over the rest volume (eq. 1).

    Args:
        mesh: Rest mesh.
        displacement: At the mesh's points [m], shape (num_points, 3); linear in between.
        material: Elastic constants.
        strain: Strain measure.
        degree: Polynomial degree of the test functions N.
        inclusions: Cells with other elastic constants.
        element: Smoothed tetrahedra are of degree 1.

    Returns:
        Internal force at the mesh's points [N], shape (num_points, 3). For degree 1 it sums to
        zero over the body; beyond that the nodes on the edges carry the rest.

    Raises:
        InputError: Wrong shape, a value that is not finite, or smoothed tetrahedra of another
            degree or on several ranks.
    """
    space = create_space(transfer(mesh), degree)
    body = ElasticBody(space, material, Strain(strain), inclusions, element=Element(element))
    return body.space.at_points(body.internal_force(body.space.from_points(displacement)))
