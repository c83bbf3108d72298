"""Condense a body to its compliance at touched points; how much memory that takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.condensed.elimination import (
    components_of,
    condense_matrix,
    invert_in_place,
)
from palpate.fastsim.condensed.setup import CondensedTooLargeError
from palpate.fastsim.condensed.model import CompliancePrecision, CondensedModel
from palpate.fastsim.condensed.model import model_key
from palpate.fastsim.condensed.setup import (
    COLUMNS,
    CondensedSetup,
    CondensedSize,
    held_fields_of,
)
from palpate.fastsim.supports import HeldPoints
from palpate.meshes.arrays import Floats, Points
from palpate.meshes.problem import Element, Problem

# What a model may take while it is made, where nobody says otherwise.
MOST_BYTES = 4_000_000_000


def condense(
    problem: Problem,
    *,
    element: Element = Element.LINEAR,
    touched: ArrayLike | None = None,
    seen: ArrayLike | None = None,
    precision: CompliancePrecision = CompliancePrecision.DOUBLE,
    keep_inside: bool = False,
    most_bytes: int = MOST_BYTES,
    progress: Callable[[str], None] | None = None,
) -> CondensedModel:
    """Precompute what a body's surface does under forces: the condensed linear model.

    Static condensation of eq. 5 and the inverse of what is left (Bro-Nielsen and Cotin 1996,
    "Real-time volumetric deformable models for surgery simulation using finite elements and
    condensation"; the paper's [7]). Supports and anchors of springs move freely afterwards, by
    columns of their own; springs are at full stiffness, as in statics.

    Args:
        problem: Mesh, material, supports, loads and springs; its tools and time are not read.
        element: Linear tetrahedra, plain or smoothed.
        touched: Points on which forces may act, none held in all components; None is every such
            point of the boundary.
        seen: Points whose displacements are wanted besides; None is the touched ones alone.
        precision: Of the kept compliance: single halves the memory, and is exact to 1e-7.
        keep_inside: Keep what `CondensedModel.whole_displacement` needs.
        most_bytes: Allowed while the model is made.
        progress: Called with one line now and then; the first says what it takes.

    Returns:
        The model.

    Raises:
        UnsupportedBodyError: The body can float.
        CondensedTooLargeError: It would need more memory; nothing has been taken yet.
        NotCondensableError: A load that depends on the displacement, or a touched point that is
            held.

    Note:
        Engineering strain: wrong where the body turns or strains much.
    """
    setup = CondensedSetup(problem, element, touched, seen)
    return condense_setup(
        setup,
        precision=precision,
        keep_inside=keep_inside,
        most_bytes=most_bytes,
        progress=progress,
    )


def condense_setup(
    setup: CondensedSetup,
    *,
    precision: CompliancePrecision,
    keep_inside: bool,
    most_bytes: int,
    progress: Callable[[str], None] | None,
) -> CondensedModel:
    """What `condense` does once it is set up.

    Raises:
        CondensedTooLargeError: As of `condense`.
    """
    size = setup.size(precision, keep_inside)
    if size.peak_bytes > most_bytes:
        raise CondensedTooLargeError(size.peak_bytes, most_bytes, str(size))
    if progress:
        progress(f"condensing: {size}")
    keeps = keep_inside or len(setup.others) > 0
    condensed = condense_matrix(
        setup.graph,
        setup.blocks,
        setup.right_sides,
        setup.dissection,
        keeps_couplings=keeps,
        progress=progress,
    )
    dense = condensed.stiffness
    invert_in_place(dense)
    held = setup.is_free[setup.touched].reshape(-1) == 0
    dense[held, held] = 0.0
    columns = dense @ condensed.loads
    # Displacements by each right-hand side, and where supports put held components.
    whole = setup.held_fields.copy()
    whole[components_of(setup.touched)] += columns
    numbers = np.empty((setup.num_blocks, 9), precision.dtype)
    rows = setup.rows(numbers)
    if len(setup.others):
        eye = np.eye(columns.shape[1])
        extended = condensed.extend(columns, setup.problem.mesh.num_points, eye)
        others = components_of(setup.others)
        whole[others] += extended[others]
        for begin in range(0, dense.shape[1], COLUMNS):
            part = dense[:, begin : begin + COLUMNS]
            response = condensed.extend(part, setup.problem.mesh.num_points)[others]
            setup.fill_others(rows, response, begin)
    setup.fill_touched(rows, dense)
    in_space = [setup.to_space(whole[:, k].reshape(-1, 3)) for k in range(whole.shape[1])]
    at_seen = np.array(in_space)[:, setup.seen]
    # The matrix itself has become its inverse; it is not asked for again.
    inside = dataclasses.replace(condensed, stiffness=np.zeros((0, 0))) if keep_inside else None
    return CondensedModel(
        problem=setup.problem,
        element=setup.element,
        precision=precision,
        touched=setup.touched,
        seen=setup.seen,
        blocks=numbers,
        load_displacement=at_seen[0],
        terms=setup.terms,
        term_displacements=at_seen[1 : 1 + len(setup.terms)],
        anchor_displacements=at_seen[1 + len(setup.terms) :].reshape(-1, 3, len(setup.seen), 3),
        key=model_key(setup, precision),
        inside=inside,
    )


def condensed_size(
    problem: Problem,
    *,
    element: Element = Element.LINEAR,
    touched: ArrayLike | None = None,
    seen: ArrayLike | None = None,
    precision: CompliancePrecision = CompliancePrecision.DOUBLE,
    keep_inside: bool = False,
) -> CondensedSize:
    """Memory and work that `condense` would take, told without doing it.

    Args:
        problem: As of `condense`; the other arguments as well.
        element: Likewise.
        touched: Likewise.
        seen: Likewise.
        precision: Likewise.
        keep_inside: Likewise.

    Returns:
        Its size.

    Raises:
        UnsupportedBodyError, NotCondensableError: As of `condense`.
    """
    return CondensedSetup(problem, element, touched, seen).size(precision, keep_inside)


def extend_inside(model: CondensedModel, touched: Points, factors: Floats) -> Points:
    """Displacement of all points from that of the touched ones [m], shape (num_points, 3).

    Args:
        model: With its inside.
        touched: Displacement of the touched points [m], shape (num_touched, 3).
        factors: Of the loads, of each term, and displacements of the springs' anchors [m].
    """
    assert model.inside is not None
    problem = model.problem
    supports = HeldPoints(problem)
    fields = held_fields_of(problem, supports, model.terms)
    held = (fields @ factors[: fields.shape[1]]).reshape(-1, 3)
    at_touched = np.zeros_like(problem.mesh.points)
    at_touched[model.touched] = touched
    # Free components follow the elimination; held ones are where their supports put them.
    own = np.where(supports.is_free != 0, supports.to_local(at_touched), 0.0)[model.touched]
    found = model.inside.extend(
        own.reshape(-1, 1), problem.mesh.num_points, factors[:, None]
    ).reshape(-1, 3)
    return supports.to_global(np.where(supports.is_free != 0, found, held))
