"""Choice of the compiled step kernel: the widest that the processor has, or a given one."""

from __future__ import annotations

import os

from palpate.fastsim import _core
from palpate.meshes.errors import InputError

VARIABLE = "PALPATE_INSTRUCTION_SET"


def chosen_instruction_set() -> _core.InstructionSet:
    """The widest instruction set to use for explicit steps.

    The environment variable PALPATE_INSTRUCTION_SET (baseline, avx2 or avx512) sets an upper
    bound, to compare the kernels or to work around a processor; the kernels agree to rounding,
    and each repeats bit for bit.

    Raises:
        InputError: The variable names no instruction set.
    """
    widest = _core.widest_instruction_set()
    name = os.environ.get(VARIABLE, "")
    if not name:
        return widest
    by_name = {known.name: known for known in _core.InstructionSet}
    if name not in by_name:
        raise InputError(f"{VARIABLE} = {name!r}: needs one of {', '.join(by_name)}")
    # Members come from the narrowest to the widest.
    order = list(_core.InstructionSet)
    return min(by_name[name], widest, key=order.index)
