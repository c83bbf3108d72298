"""Python environments that may hold rivals: this one, and those PALPATE_BENCH_PYTHON names."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys

from palpate.meshes.errors import InputError

VARIABLE = "PALPATE_BENCH_PYTHON"


def interpreters() -> list[str]:
    """This interpreter, then those of PALPATE_BENCH_PYTHON, separated like PATH.

    Raises:
        InputError: One that is not there.
    """
    others = [other for other in os.environ.get(VARIABLE, "").split(os.pathsep) if other]
    for other in others:
        if shutil.which(other) is None:
            raise InputError(f"{VARIABLE}: no program {other}; name interpreters, as in PATH")
    return [sys.executable, *(other for other in others if other != sys.executable)]


def interpreter_with(module: str) -> str | None:
    """The first of them that can import a module; None where none can."""
    return next((one for one in interpreters() if _imports(one, module)), None)


@functools.cache
def _imports(interpreter: str, module: str) -> bool:
    command = [interpreter, "-P", "-c", f"import {module}"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
