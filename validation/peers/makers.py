"""What makes a simulator's result: all that a cached one must have been made by to be used again.

Of an adapter that is palpate and the adapters' sources, the command, the interpreter with the files
of every module that it can import, the packages that the registry names with version and RECORD,
the program, what the system has installed, and the variables that Python and the loader obey.

Of a command of one's own it cannot be known: a program on the path may be a wrapper of another one,
and imports and reads what it likes. Neither can it where a package is installed as a link to
sources elsewhere. Such results are never used again.
"""

from __future__ import annotations

import functools
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

from palpate.meshes.fingerprint import file_hash, palpate_hash
from palpate.validation.cached_results import Maker, system_packages, text_hash
from palpate.validation.exchange import case_folder
from palpate.validation.peers import registry
from palpate.validation.peers.registry import Peer

# What they name is imported or loaded, or decides how many threads add up.
_VARIABLES = ("PYTHON", "LD_", "OMP_")
# Of what an interpreter imports, size and time of every file: hashes of them take a minute.
# Links are followed; palpate itself is hashed as such.
_PROBE = """
import hashlib, importlib.metadata, json, os, re, sys, sysconfig
own = sysconfig.get_paths()
folders = [p for p in sys.path if p not in ("", own["stdlib"], own["platstdlib"])]
digest, count, seen = hashlib.sha256(), 0, set()
def add(path):
    found = os.stat(path) if os.path.exists(path) else os.lstat(path)
    digest.update(f"|{path}|{found.st_size}|{found.st_mtime_ns}".encode("utf-8", "replace"))
for folder in [*folders, os.path.join(sys.prefix, "conda-meta")]:
    if os.path.isfile(folder):
        add(folder)
    for where, names, files in os.walk(folder, followlinks=True):
        skipped = ("__pycache__", "palpate") if where == folder else ("__pycache__",)
        seen.add(os.path.realpath(where))
        names[:] = sorted(n for n in names if n not in skipped
                          and os.path.realpath(os.path.join(where, n)) not in seen)
        for name in sorted(files):
            add(os.path.join(where, name))
        count += len(files)
        assert count < 1_000_000
packages, linked = {}, []
for one in importlib.metadata.distributions():
    name = re.sub("[-_.]+", "-", one.metadata["Name"]).lower()
    record = hashlib.sha256((one.read_text("RECORD") or "").encode()).hexdigest()
    packages.setdefault(name, f"{one.version}, RECORD {record}")
    if '"editable": true' in (one.read_text("direct_url.json") or "") and name != "palpate":
        linked.append(name)
print(json.dumps({"Python": sys.version, "executable": sys.executable, "packages": packages,
                  "modules": digest.hexdigest(), "linked": linked}))
"""


def maker_of(peer: Peer) -> Maker | None:
    """What would make a simulator's results now; None where that cannot be known."""
    command = peer.command_line()
    if not peer.adapter or command is None:
        return None
    found = {
        "palpate": palpate_hash(),
        "words of case.json": file_hash(Path(case_folder.__file__).with_name("conventions.toml")),
        "adapters": text_hash(*(file_hash(f) for f in sorted(registry.ADAPTERS.glob("*.py")))),
        "command": command,
        "variables": text_hash(
            *(f"{k}={v}" for k, v in sorted(os.environ.items()) if k.startswith(_VARIABLES))
        ),
        **system_packages(),
    }
    interpreter = peer.interpreter()
    installed = None if interpreter is None else _installed(interpreter)
    names = ("Python", "modules", *(re.sub("[-_.]+", "-", p).lower() for p in peer.packages))
    if installed is None or not installed.keys() >= set(names):
        return None
    found |= {name: installed[name] for name in names}
    if peer.program:
        program = _program(peer.program)
        if program is None:
            return None
        found[peer.program] = program
    return found


def _program(name: str) -> str | None:
    """Path and hash of a program on the path; None of a script, which may call another one."""
    path = shutil.which(name)
    if path is None:
        return None
    with Path(path).open("rb") as stream:
        is_script = stream.read(2) == b"#!"
    return None if is_script else f"{os.path.realpath(path)}, SHA-256 {file_hash(path)}"


@functools.cache
def _installed(interpreter: str) -> dict[str, str] | None:
    """Python, "modules" and every package of an interpreter; None where it cannot say."""
    command = [interpreter, "-P", "-c", _PROBE]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    if done.returncode != 0:
        return None
    said = json.loads(done.stdout)
    if said["linked"]:
        return None
    files = [file_hash(os.path.realpath(path)) for path in (interpreter, said["executable"])]
    return {
        **said["packages"],
        "Python": ", ".join((said["Python"], *files)),
        "modules": said["modules"],
    }
