"""Condensed models that are kept in files, so that nothing is condensed twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from numpy.typing import ArrayLike

from palpate.fastsim.condensed.condense import MOST_BYTES, condense_setup
from palpate.fastsim.condensed.model import CompliancePrecision, CondensedModel
from palpate.fastsim.condensed.model import model_key, read_model
from palpate.fastsim.condensed.setup import CondensedSetup
from palpate.meshes.errors import FileFormatError
from palpate.meshes.problem import Element, Problem


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
        path: Of the file.
        problem: As of `condense`; the other arguments as well.
        element: Likewise.
        touched: Likewise.
        seen: Likewise.

    Returns:
        The model, with its inside where that was kept.

    Raises:
        FileFormatError: No such file, no model, or one of another problem, element or points.
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
    """The model from a folder where it is there, else made by `condense` and kept there.

    A model's file is named by its key: mesh, material, supports, springs, loads, element, points,
    precision and version. A file that cannot be used is made anew; nothing is ever taken away from
    the folder, and a model's file is as large as `CondensedModel.num_bytes` and its inside.

    Args:
        folder: Made where it is not there.
        problem: As of `condense`; the other arguments as well.
        element: Likewise.
        touched: Likewise.
        seen: Likewise.
        precision: Likewise.
        keep_inside: Likewise.
        most_bytes: Likewise.
        progress: Likewise.

    Returns:
        The model, with its inside where that is asked for.

    Raises:
        UnsupportedBodyError, CondensedTooLargeError, NotCondensableError: As of `condense`.
        FileFormatError: The folder cannot be made; where a file cannot be written, that is told.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(folder, f"is no folder for condensed models ({error})") from error
    setup = CondensedSetup(problem, element, touched, seen)
    path = Path(folder) / f"condensed-{model_key(setup, precision)[:32]}.npz"
    tell = progress or (lambda _: None)
    if path.exists():
        try:
            model = read_model(path, setup)
        except FileFormatError as error:
            tell(f"{error}; made anew")
        else:
            if model.inside is not None or not keep_inside:
                tell(f"condensed before: {path}")
                return model
    model = condense_setup(
        setup,
        precision=precision,
        keep_inside=keep_inside,
        most_bytes=most_bytes,
        progress=progress,
    )
    try:
        model.save(path)
    except OSError as error:
        tell(f"not kept for the next time: {path} ({error})")
    else:
        tell(f"kept for the next time: {path}, {path.stat().st_size / 1e6:.0f} MB")
    return model
