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
def versions_with(interpreter: str, module: str, packages: tuple[str, ...]) -> str:
    """Of an interpreter and of packages that it has; of a module without one, size and date.

    "" where it does not say.
    """
    command = [interpreter, "-P", "-c", _VERSIONS, module, *packages]
    return subprocess.run(command, capture_output=True, check=False, text=True).stdout


@functools.cache
def version_of_program(program: str) -> str:
    """What it says when it is asked for its version with -v."""
    done = subprocess.run([program, "-v"], capture_output=True, check=False, text=True)
    return done.stdout + done.stderr


_VERSIONS = """
import importlib.metadata, importlib.util, os, platform, sys
module, *packages = sys.argv[1:]
print("Python", platform.python_version())
for package in packages:
    print(package, importlib.metadata.version(package))
if not packages:
    found = os.stat(importlib.util.find_spec(module).origin)
    print(module, found.st_size, found.st_mtime_ns)
"""


@functools.cache
def _imports(interpreter: str, module: str) -> bool:
    command = [interpreter, "-P", "-c", f"import {module}"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
