"""What Windows does not have is asked for before it is used: every module loads, a gate passes."""

import subprocess
import sys

import pytest

# A stand-in for Windows, which nobody has tried: what Python does not have there is taken away
# once the libraries of others, which choose by the system, have been loaded.
WITHOUT_POSIX = """
import contextlib, importlib, os, pkgutil, signal, sys

ALONE = ("palpate.meshes.supervisor", ".adapters.")  # programs; the first runs on Linux alone

names = []
for room in ("meshes", "fastsim", "validation"):
    package = importlib.import_module(f"palpate.{room}")
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not any(part in module.name for part in ALONE):
            with contextlib.suppress(ImportError):  # extras that are not installed
                importlib.import_module(module.name)
                names.append(module.name)
for name in ("resource", "fcntl", "pwd", "grp", "termios"):
    sys.modules[name] = None
for name in (
    "fork", "killpg", "setsid", "getuid", "geteuid", "getloadavg", "sched_getaffinity", "sysconf",
    "waitid", "O_NOFOLLOW", "O_NONBLOCK", "pidfd_open",
):
    delattr(os, name)
for name in ("SIGHUP", "SIGPIPE", "SIGCHLD", "SIGXCPU", "SIGXFSZ", "SIGALRM"):
    delattr(signal, name)
for name in [name for name in sys.modules if name.split(".")[0] == "palpate"]:
    if not name.endswith("._core"):
        del sys.modules[name]
for name in names:
    importlib.import_module(name)

from palpate.validation.cli import main
sys.argv[1:] = ["gate", "block-fine", "--element", "smoothed"]
main()
"""


@pytest.mark.long
def test_every_module_loads_and_a_gate_passes_without_posix(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX],
        capture_output=True,
        text=True,
        timeout=600,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
