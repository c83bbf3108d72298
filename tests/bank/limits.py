"""Code run in a process of its own, with little memory and a time after which it counts as hung."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

# Code that prints the largest memory of its process [B]. Not getrusage's: that is at least that of
# the process it was started from.
PRINT_MOST_MEMORY = """
with open("/proc/self/status", encoding="ascii") as status:
    print(1024 * int(status.read().split("VmHWM:")[1].split()[0]))
"""
_LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({most}, {most}))
from palpate.meshes.errors import InputError
try:
{code}
except InputError as error:
    print("refused:", type(error).__name__, error)
"""


def run_limited(
    code: str, *words: object, most_bytes: float = 3e9, seconds: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run Python code under a limit of memory; a refusal is printed as a line "refused: ...".

    Args:
        code: What to run; `sys` is imported.
        words: For `sys.argv[1:]`.
        most_bytes: Of address space; the interpreter with its libraries takes about 1e9.
        seconds: After these it hangs, which is an error here.
    """
    if "libasan" in os.environ.get("LD_PRELOAD", ""):
        pytest.skip("sanitizers reserve terabytes of addresses")
    indented = "\n".join(f"    {line}" for line in code.strip().splitlines())
    return subprocess.run(
        [sys.executable, "-c", _LIMITED.format(most=int(most_bytes), code=indented),
         *map(str, words)],
        capture_output=True, text=True, timeout=seconds, check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


def refusal(code: str, *words: object, most_bytes: float = 3e9, seconds: float = 120.0) -> str:
    """What a piece of code, run under limits, is refused with."""
    done = run_limited(code, *words, most_bytes=most_bytes, seconds=seconds)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.startswith("refused: "), done.stdout[-3000:]
    return done.stdout.removeprefix("refused: ").strip()


def read_file_refusal(call: str, path: Path, **limits: float) -> str:
    """What reading a file is refused with: `call` is module.function of a path."""
    module, _, function = call.rpartition(".")
    return refusal(f"from {module} import {function}\n{function}(sys.argv[1])", path, **limits)
