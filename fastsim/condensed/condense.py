"""Condense a body to its compliance at touched points, report the memory, store the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from palpate.fastsim.condensed.elimination import components_of, condense_matrix, invert_in_place
from palpate.fastsim.condensed.model import CondensedModel, model_key, read_model
from palpate.fastsim.condensed.setup import (
    COLUMNS,
    CompliancePrecision,
    CondensedSetup,
    CondensedSize,
    CondensedTooLargeError,
)
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element, Problem

# Default limit of the memory in use while a model is made [bytes].
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
        touched: Points on which forces may act, none fixed in all components; None is every such
            point of the boundary.
        seen: Further points whose displacements are wanted; None is the touched ones alone.
        precision: Precision of the compliance: single halves the memory, and is exact to 1e-7.
        keep_inside: Whether to store what `CondensedModel.whole_displacement` needs.
        most_bytes: Allowed while the model is made.
        progress: Called with one line now and then; the first states the memory and the work.

    Returns:
        The model.

    Raises:
        UnsupportedBodyError: The body can float.
        CondensedTooLargeError: It would need more memory; none has been allocated yet.
        NotCondensableError: A touched point that is fixed.

    Note:
        Engineering strain: wrong where the body turns or strains much.
    """
    setup = CondensedSetup(problem, element, touched, seen)
    return condense_setup(setup, precision, keep_inside, most_bytes, progress)


def condense_setup(
    setup: CondensedSetup,
    precision: CompliancePrecision,
    keep_inside: bool,
    most_bytes: int,
    progress: Callable[[str], None] | None,
) -> CondensedModel:
    """Condense a body whose matrix has been set up; see `condense`, and for what it raises."""
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
    fixed = setup.is_free[setup.touched].reshape(-1) == 0
    dense[fixed, fixed] = 0.0
    columns = dense @ condensed.loads
    # Displacements by each right-hand side, and where supports put fixed components.
    whole = setup.prescribed_fields.copy()
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
    # The matrix has been overwritten by its inverse and is not needed again.
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
    """Memory and work that `condense` would take, without doing it.

    Args:
        problem: Mesh, material, supports, loads and springs, as in `condense`.
        element: Linear tetrahedra, plain or smoothed.
        touched: Points on which forces may act; None is the boundary, as in `condense`.
        seen: Further points whose displacements are wanted; None is none.
        precision: Precision of the stored compliance.
        keep_inside: Whether to store what `CondensedModel.whole_displacement` needs.

    Returns:
        Its size.

    Raises:
        UnsupportedBodyError, NotCondensableError: For the same reasons as in `condense`.
    """
    return CondensedSetup(problem, element, touched, seen).size(precision, keep_inside)


def load_condensed(
    path: str | Path,
    problem: Problem,
    *,
    element: Element = Element.LINEAR,
    touched: ArrayLike | None = None,
    seen: ArrayLike | None = None,
) -> CondensedModel:
    """Read a model that `CondensedModel.save` wrote, for the same problem and arguments.

    Args:
        path: The file.
        problem: Mesh, material, supports, loads and springs, as in `condense`.
        element: Linear tetrahedra, plain or smoothed.
        touched: Points on which forces may act; None is the boundary, as in `condense`.
        seen: Further points whose displacements are wanted; None is none.

    Returns:
        The model, with its inside where that was stored.

    Raises:
        FileFormatError: No such file, no model, one that has changed since it was written, or one
            of another problem, element or points, or made by another palpate.
    """
    return read_model(path, CondensedSetup(problem, element, touched, seen))


def condense_once(
    folder: str | Path,
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
    """Read the model from a folder; if it is not there, make it by `condense` and store it there.

    A model's file is named by its key: mesh, material, supports, springs, loads, element, points,
    precision and version. It has the hash of its numbers and of the palpate that made it: a file
    that has changed, or was made by another palpate, is not used but made anew, and that is said.
    Nothing is ever deleted from the folder, and a model's file is as large as
    `CondensedModel.num_bytes` and its inside.

    Args:
        folder: Created if it does not exist.
        problem: Mesh, material, supports, loads and springs, as in `condense`.
        element: Linear tetrahedra, plain or smoothed.
        touched: Points on which forces may act; None is the boundary, as in `condense`.
        seen: Further points whose displacements are wanted; None is none.
        precision: Precision of the stored compliance.
        keep_inside: Whether to store what `CondensedModel.whole_displacement` needs.
        most_bytes: Allowed while the model is made.
        progress: Called with one line now and then.

    Returns:
        The model, with its inside where that is asked for.

    Raises:
        UnsupportedBodyError, CondensedTooLargeError, NotCondensableError: As in `condense`.
        FileFormatError: The folder cannot be made. A file that cannot be written is only reported.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(folder, f"is no folder for condensed models ({error})") from error
    setup = CondensedSetup(problem, element, touched, seen)
    path = Path(folder) / f"condensed-{model_key(setup, precision)[:32]}.npz"
    tell = progress or (lambda _: None)
    if path.exists() or path.is_symlink():
        try:
            if path.is_symlink():
                raise FileFormatError(path, "is a link, which may lead anywhere")
            model = read_model(path, setup)
        except FileFormatError as error:
            tell(f"{error}; made anew")
        else:
            if model.inside is not None or not keep_inside:
                tell(f"condensed before, on {model.made}: {path}")
                return model
    model = condense_setup(setup, precision, keep_inside, most_bytes, progress)
    try:
        if path.is_symlink():  # writing would replace what it leads to
            raise OSError("a link")
        model.save(path)
    except OSError as error:
        tell(f"not stored for the next time: {path} ({error})")
    else:
        tell(f"stored for the next time: {path}, {path.stat().st_size / 1e6:.0f} MB")
    return model
