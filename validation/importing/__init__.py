"""Models of other simulators as cases: FEBio's .feb, Abaqus' and CalculiX' .inp, MuJoCo's .xml."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import scratch_folder
from palpate.validation.case import load_case
from palpate.validation.importing.abaqus import read_abaqus
from palpate.validation.importing.case_files import Imported, as_case
from palpate.validation.importing.febio import read_febio
from palpate.validation.importing.model import ImportRefusedError, Model, UnitSystem
from palpate.validation.importing.mujoco import read_mujoco

__all__ = ["ImportRefusedError", "Imported", "UnitSystem", "import_model"]

_READERS: dict[str, Callable[[Path], Model]] = {
    ".feb": read_febio,
    ".inp": read_abaqus,
    ".xml": read_mujoco,
    ".mjcf": read_mujoco,
}


def import_model(path: Path, target: Path, units: UnitSystem | None = None) -> Imported:
    """Write a model of another simulator as a case, TARGET.toml, with its mesh beside it.

    Args:
        path: .feb, .inp, or .xml (MuJoCo).
        target: The case file to be; its mesh goes beside it, with the ending .msh.
        units: Units of the file; of FEBio's files some state them.

    Returns:
        What was written, with what a reader has to know, and what was left out.

    Raises:
        ImportRefusedError: What a case cannot say; the message names file and line.
        InputError: No units, another kind of file, or a body that cannot be used.
    """
    if target.suffix != ".toml":
        raise InputError(f"{target}: a case file needs the ending .toml")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: unknown kind of model; use {', '.join(_READERS)}")
    model = reader(path)
    if model.units is not None:
        stated, source = model.units
        if units not in (None, stated):
            raise source.refuse(
                f"the file says {stated}, --units says {units}: take one of them out"
            )
        units = stated
    if units is None:
        raise InputError(_ask_for_units(model))
    imported = as_case(model, units, target)
    with scratch_folder("import") as folder:
        # Meshes that cannot be, bodies that float: known before anything is written.
        imported.write(folder / target.name)
        _ = load_case(folder / target.name).problem
    imported.write(target)
    return imported


def _ask_for_units(model: Model) -> str:
    """What the model would be in each system, so that a person sees which is meant."""
    used = model.nodes[np.unique(model.corners)]
    size = float(np.ptp(used, axis=0).max()) if len(used) else 0.0
    constants = model.bodies[0].constants if model.bodies else {}
    name, value = next(((k, v) for k, v in constants.items() if isinstance(v, float)), ("E", 0.0))
    choices = []
    for system in UnitSystem:
        units = system.table
        long, stress = f"{size:g} {units['length']} long", f"{value:g} {units['stress']}"
        choices.append(f"{system} ({long}, {name} {stress})")
    return (
        f"{model.path.name} does not say its units, and nothing is guessed: give --units, one of "
        + "; ".join(choices)
    )
