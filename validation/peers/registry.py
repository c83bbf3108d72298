"""Simulators of others, one row each of `registry.toml`, and the Python environments they live in.

Gate, frontier, benchmarks and scoreboard take their simulators from here; the adapter of a row runs
it. A tool may be installed in another Python environment: PALPATE_BENCH_PYTHON names interpreters
to try besides this one, separated like PATH.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element
from palpate.meshes.untrusted import UntrustedTextError, parse_toml, read_text
from palpate.validation.peers import adapters

FILE = Path(__file__).parent / "registry.toml"
ADAPTERS = Path(adapters.__file__).parent
VARIABLE = "PALPATE_BENCH_PYTHON"
# The name of palpate in its own rows of a benchmark.
OURS = "palpate"


@dataclass(frozen=True)
class Tool:
    """A tool that is timed in a benchmark.

    Attributes:
        name: Its name in the rows; our own is "palpate".
        adapter: Its file in the folder of adapters, without .py.
        install: How it is installed.
        options: Options for its adapter, besides the job.
        runs_everywhere: Whether it is timed in all interpreters that have another version of it.
    """

    name: str
    adapter: str
    install: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    runs_everywhere: bool = False


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Setting(_Model):
    """A setting that was chosen for a simulator, and the source that recommends it."""

    what: str = Field(min_length=1)
    source: str = Field(min_length=1)


class Timing(_Model):
    """The benchmark in which a row is timed, and the name of its tool there."""

    of: str
    tool: str
    options: dict[str, Any] = Field(default_factory=dict)
    install: str = ""
    runs_everywhere: bool = False


class Peer(_Model):
    """A simulator, or another tool that is timed.

    Attributes:
        name: Short name of letters, digits and hyphens, for its page and its column.
        title: Name for people.
        law: The law that it solves; a case's body follows it instead of the case's own.
        compiles: Whether its first run here compiles what later ones reuse.
        adapter: Its file in the folder of adapters, without .py.
        options: Options for its adapter.
        module: Module that its interpreter must have; "" for a program on the path.
        packages: Packages whose versions its results depend on; by default those of the module.
        program: Program that must be on the path.
        install: How it is installed.
        homepage: Address of the project.
        settings: Exact settings, with their sources.
        better: How to get better results from it, a sentence each.
        command: Command of a simulator without adapter: "mysim {case} {result}".
        element: Element of fastsim, which is no outside simulator.
        on_board: Whether it is on the scoreboard.
        frontier: Its largest number of divisions in the study frontier; 0 leaves it out there.
        bench: The benchmarks that it is timed in.
    """

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")
    title: str = Field(min_length=1)
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    compiles: bool = False
    adapter: str = ""
    options: dict[str, Any] = Field(default_factory=dict)
    module: str = ""
    packages: tuple[str, ...] = ()
    program: str = ""
    install: str = ""
    homepage: str = ""
    settings: tuple[Setting, ...] = ()
    better: tuple[str, ...] = ()
    command: str = ""
    element: Element | None = None
    on_board: bool = True
    frontier: int = 0
    bench: tuple[Timing, ...] = ()

    @property
    def is_outside(self) -> bool:
        """Whether it is an outside simulator."""
        return self.element is None

    @property
    def is_quadratic(self) -> bool:
        """Whether it uses quadratic tetrahedra on the case's mesh."""
        return self.options.get("degree") == 2

    @property
    def adapter_lines(self) -> int:
        """Number of lines of its adapter."""
        return len((ADAPTERS / f"{self.adapter}.py").read_text("utf-8").splitlines())

    def command_line(self) -> str | None:
        """The command line that runs it; None where the simulator is not installed here."""
        if self.command:
            return self.command
        if self.program and shutil.which(self.program) is None:
            return None
        interpreter = interpreter_with(self.module) if self.module else sys.executable
        if interpreter is None:
            return None
        words = [interpreter, f"{ADAPTERS / self.adapter}.py", "{case}", "{result}"]
        return " ".join([*words, *self._option_words])

    @property
    def _option_words(self) -> list[str]:
        return [f"{name}={value}" for name, value in self.options.items()]

    def why_missing(self) -> str:
        """How a reader can install it."""
        where = "" if self.program else f" ({VARIABLE} names other interpreters)"
        return f"not installed here: {self.install}{where}"

    def sources_hash(self) -> str:
        """SHA-256 over what runs it: its adapter with the files that this imports, or a command.

        For a command the files that it names count too; for an adapter the versions that it runs.
        """
        if self.adapter:
            texts = [*_texts_of(self.adapter), " ".join(self._option_words).encode()]
        else:
            files = [Path(word) for word in shlex.split(self.command)]
            texts = [self.command.encode(), *(f.read_bytes() for f in files if f.is_file())]
        return hashlib.sha256(b"\0".join([*texts, self.versions().encode()])).hexdigest()

    def versions(self) -> str:
        """The versions that are installed here, as it states them."""
        program = version_of_program(self.program) if self.program else ""
        interpreter = interpreter_with(self.module) if self.module else None
        if interpreter is None:
            return program
        return program + versions_with(interpreter, self.module, self.packages)


@functools.cache
def _texts_of(adapter: str) -> list[bytes]:
    """The texts of an adapter and of all files of the folder that it imports, also indirectly."""
    found: dict[str, bytes] = {}
    waiting = [adapter]
    while waiting:
        name = waiting.pop()
        file = ADAPTERS / f"{name}.py"
        if name in found or not file.is_file():
            continue
        found[name] = file.read_bytes()
        for node in ast.walk(ast.parse(found[name])):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                waiting.append(node.module)
    return [found[name] for name in sorted(found)]


FASTSIM = tuple(
    Peer(
        name=f"fastsim-{element}",
        title=f"fastsim, {element}",
        element=element,
        settings=(
            Setting(
                what="Newton's method to a relative residual of 1e-10; of motions, central "
                "differences with the case's step, or its own stable one",
                source="palpate's own",
            ),
        ),
    )
    for element in Element
)


def read_peers(path: Path = FILE) -> tuple[Peer, ...]:
    """Every row of a registry, in its order, and fastsim's last.

    Raises:
        FileFormatError: It is missing or no TOML, has an unknown key, or two rows of one name.
    """
    try:
        given: dict[str, Any] = parse_toml(read_text(path))
        rows = TypeAdapter(tuple[Peer, ...]).validate_python(given.get("peer", ()))
    except (UntrustedTextError, ValidationError) as error:
        raise FileFormatError(path, f"no table of simulators ({error})") from error
    peers = (*rows, *FASTSIM)
    if len({peer.name for peer in peers}) < len(peers):
        raise FileFormatError(path, "two simulators of one name")
    return peers


def peers_on_board(names: Sequence[str] | None = None) -> tuple[Peer, ...]:
    """The named simulators of the scoreboard, in their order; all of them where none is named.

    Raises:
        InputError: A name is unknown.
    """
    peers = tuple(peer for peer in read_peers() if peer.on_board)
    known = {peer.name for peer in peers}
    for name in names or ():
        if name not in known:
            raise InputError(f"no entry {name!r} on the scoreboard; there are {', '.join(known)}")
    return tuple(peer for peer in peers if not names or peer.name in names)


def tools_for(benchmark: str) -> tuple[Tool, ...]:
    """The rivals of a benchmark, in the order of their rows."""
    return tuple(
        Tool(
            timing.tool,
            peer.adapter,
            timing.install or peer.install,
            {**peer.options, **timing.options},
            timing.runs_everywhere,
        )
        for peer in read_peers()
        for timing in peer.bench
        if timing.of == benchmark
    )


def interpreters() -> list[str]:
    """This interpreter, then those of PALPATE_BENCH_PYTHON, separated like PATH.

    Raises:
        InputError: One of them does not exist.
    """
    others = [other for other in os.environ.get(VARIABLE, "").split(os.pathsep) if other]
    for other in others:
        if shutil.which(other) is None:
            raise InputError(f"{VARIABLE}: no program {other}; name interpreters, as in PATH")
    return [sys.executable, *(other for other in others if other != sys.executable)]


def interpreter_with(module: str) -> str | None:
    """The first of the interpreters that can import a module; None where none can."""
    return next((one for one in interpreters() if _imports(one, module)), None)


@functools.cache
def _imports(interpreter: str, module: str) -> bool:
    command = [interpreter, "-P", "-c", f"import {module}"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


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
def versions_with(interpreter: str, module: str, packages: tuple[str, ...]) -> str:
    """Versions of an interpreter and its packages; for a module without package, size and date.

    The result is "" where they cannot be found out.
    """
    command = [interpreter, "-P", "-c", _VERSIONS, module, *packages]
    return subprocess.run(command, capture_output=True, check=False, text=True).stdout


@functools.cache
def version_of_program(program: str) -> str:
    """What a program prints when it is called with -v for its version."""
    done = subprocess.run([program, "-v"], capture_output=True, check=False, text=True)
    return done.stdout + done.stderr
