"""Simulators of others, one row each of `registry.toml`, and the Python environments they live in.

Gate, frontier, benchmarks and scoreboard take their simulators from here; the adapter of a row runs
it. A tool may be installed in another Python environment: PALPATE_BENCH_PYTHON names interpreters
to try besides this one, separated like PATH.
"""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

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
        works_with: Released versions that the adapter is written for, FIRST:LAST; "" for all.
        beside: What is installed beside a range of its versions, in the place of `packages`.
        scatter: Error below which its results are all the same, its solver's rounding [-].
        compiles: Whether its first run here compiles what later ones reuse.
        adapter: Its file in the folder of adapters, without .py.
        options: Options for its adapter.
        module: Module that its interpreter must have; "" for a program on the path.
        packages: Packages that its results depend on: cached ones are of the same versions.
        program: Program that must be on the path.
        install: How it is installed.
        not_run: Why it is run by nobody here, where it has no adapter.
        homepage: Address of the project.
        settings: Exact settings, with their sources.
        better: How to get better results from it, a sentence each.
        command: Command of a simulator without adapter: "mysim {case} {result}".
        element: The tetrahedra that it is judged by on the same mesh, whatever its results state.
        is_outside: Whether it is an outside simulator; fastsim is none.
        on_board: Whether it is on the scoreboard.
        varies: What its adapter takes in motions beside meshes: "substeps", or "iterations" with a
            stated time step; "" where it is not in the motion of that study.
        takes_tools: Whether its adapter hands over rigid tools.
        frontier: Its largest number of divisions in the study frontier; 0 leaves it out there.
        bench: The benchmarks that it is timed in.
    """

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")
    title: str = Field(min_length=1)
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    works_with: str = ""
    beside: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    scatter: float = Field(default=1e-5, gt=0.0)
    compiles: bool = False
    adapter: str = ""
    options: dict[str, Any] = Field(default_factory=dict)
    module: str = ""
    packages: tuple[str, ...] = ()
    program: str = ""
    install: str = ""
    not_run: str = ""
    homepage: str = ""
    settings: tuple[Setting, ...] = ()
    better: tuple[str, ...] = ()
    command: str = ""
    element: Element = Element.LINEAR
    is_outside: bool = True
    on_board: bool = True
    varies: Literal["", "substeps", "iterations"] = ""
    takes_tools: bool = False
    frontier: int = 0
    bench: tuple[Timing, ...] = ()

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
        if not self.adapter or (self.program and shutil.which(self.program) is None):
            return None
        interpreter = self.interpreter()
        if interpreter is None:
            return None
        words = [interpreter, f"{ADAPTERS / self.adapter}.py", "{case}", "{result}"]
        return " ".join([*words, *self._option_words])

    def interpreter(self) -> str | None:
        """The interpreter that runs its adapter; None where none has its module."""
        return interpreter_with(self.module) if self.module else sys.executable

    @property
    def _option_words(self) -> list[str]:
        return [f"{name}={value}" for name, value in self.options.items()]

    def why_missing(self) -> str:
        """Why there is no result of it here, and how a reader can install it."""
        if self.not_run:
            return f"not run here: {self.not_run}"
        where = "" if self.program else f" ({VARIABLE} names other interpreters)"
        return f"not run here, as it is not installed: {self.install}{where}"


FASTSIM = tuple(
    Peer(
        name=f"fastsim-{element}",
        title=f"fastsim, {element}",
        element=element,
        is_outside=False,
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
    known = [peer.name for peer in peers]
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
