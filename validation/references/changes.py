"""What changed between two stored references, metric by metric."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.validation.references.errors import MissingReferenceError, UntrustedReferenceError
from palpate.validation.references.reference_files import read_reference
from palpate.validation.references.soundness import SCALARS
from palpate.validation.states import State


def describe_changes(before: Path, after: Path) -> list[str]:
    """Compare two files of references, whatever they were made for.

    Args:
        before: The accepted one; may be missing or damaged.
        after: The new one.

    Returns:
        One line for a state that is as it was; of another one for each number that every state
        carries, with its relative change, and for the largest change of displacement; and one for
        each error bar that changed.

    Raises:
        MissingReferenceError, UntrustedReferenceError: `after` is missing, damaged or altered.
    """
    new, new_key, _ = read_reference(after)
    try:
        old, old_key, _ = read_reference(before)
    except (MissingReferenceError, UntrustedReferenceError) as error:
        return [f"nothing to compare with: {error}"]
    lines = [] if old_key == new_key else ["mesh, material, supports or loads have changed"]
    for place in sorted({*old.states, *new.states}):
        name = f"{place[0]}, {place[1]} strain"
        if place not in old.states or place not in new.states:
            lines.append(f"{name}: {'gone' if place in old.states else 'new'}")
            continue
        a, b = old.states[place], new.states[place]
        if not _is_same_stress(a, b):
            lines.append(f"{name}: stresses {'new' if a.integrals is None else 'changed'}")
            if is_same_state(a, b):
                continue
        if is_same_state(a, b):
            lines.append(f"{name}: unchanged")
            continue
        for metric in ("volume", "surface_area", "smallest_det_f", "max_displacement"):
            lines.append(_change(f"{name}, {metric}", getattr(a, metric), getattr(b, metric)))
        if a.displacement.shape != b.displacement.shape:
            counts = f"{len(a.displacement)} points, now {len(b.displacement)}"
            lines.append(f"{name}, displacement: another mesh ({counts})")
        else:
            largest = float(abs(b.displacement - a.displacement).max())
            scale = float(abs(a.displacement).max())
            lines.append(
                f"{name}, displacement: at most {largest:.3g} m apart, "
                f"{largest / scale if scale else float(largest > 0.0):.2g} of the largest"
            )
    for metric, strain in sorted({*old.bars, *new.bars}):
        before_bar, after_bar = old.bars.get((metric, strain)), new.bars.get((metric, strain))
        if before_bar != after_bar:
            lines.append(
                f"error bar of {metric}, {strain} strain: {_bar(before_bar)}, now {_bar(after_bar)}"
            )
    return lines


def is_same_state(one: State | None, other: State | None) -> bool:
    """Whether two stored states hold the same numbers, to the last bit; stresses left out."""
    if one is None or other is None:
        return False
    scalars = [getattr(one, name) == getattr(other, name) for name in SCALARS]
    motions = [None if s.trajectory is None else s.trajectory.displacements for s in (one, other)]
    pairs = [
        (one.displacement, other.displacement),
        (one.tool_forces, other.tool_forces),
        (motions[0], motions[1]),
    ]
    return all(scalars) and all(
        a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs
    )


def _is_same_stress(one: State, other: State) -> bool:
    kept = [state.integrals for state in (one, other)]
    if None in kept:
        return kept[0] is kept[1]
    a, b = kept
    assert a is not None
    assert b is not None
    pairs = ((a.cauchy, b.cauchy), (a.internal_force, b.internal_force))
    is_same = a.strain_energy == b.strain_energy
    return is_same and all(np.array_equal(*pair) for pair in pairs)


def _change(name: str, before: float, after: float) -> str:
    relative = abs(after - before) / abs(before) if before else float(after != before)
    return f"{name}: {before:.9g}, now {after:.9g} (relative change {relative:.2g})"


def _bar(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"
