"""Who stands on the scoreboard: simulators of the folder of adapters, with settings and sources.

What an entry says is in `entries.toml` beside this file; how it is run, in its adapter.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from palpate.meshes.errors import FileFormatError, InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element
from palpate.meshes.untrusted_text import UntrustedTextError, parse_toml, read_text
from palpate.validation.candidates.interpreters import (
    VARIABLE,
    interpreter_with,
    version_of_program,
    versions_with,
)
from palpate.validation.peers import adapters

FILE = Path(__file__).parent / "entries.toml"
ADAPTERS = Path(adapters.__file__).parent


class Setting(BaseModel):
    """One choice that was made for a simulator, and who recommends it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    what: str = Field(min_length=1)
    source: str = Field(min_length=1)


class Entry(BaseModel):
    """A simulator as it stands on the board.

    Attributes:
        name: Short, of letters, digits and hyphens: its page and its column.
        title: For people.
        law: That it solves; a case's body follows it in the place of the case's own.
        compiles: Whether its first run here compiles what later ones find.
        is_quadratic: Whether it has quadratic tetrahedra on the case's mesh.
        adapter: Its file in the folder of adapters, without .py.
        motion: Likewise that of motions, where it is another.
        module: That its interpreter must have; "" for a program on the path.
        packages: Whose versions its answers hang on; those of the module where none is named.
        program: That must be on the path.
        install: How it is installed.
        homepage: Of the project.
        settings: Exact ones, with their sources.
        better: How better answers are got from it, a sentence each.
        command: Of a simulator that is no adapter: "mysim {case} {result}".
        element: Of fastsim, which is no outside simulator.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$")
    title: str = Field(min_length=1)
    law: Law = Law.SAINT_VENANT_KIRCHHOFF
    is_quadratic: bool = False
    compiles: bool = False
    adapter: str = ""
    motion: str = ""
    module: str = ""
    packages: tuple[str, ...] = ()
    program: str = ""
    install: str = ""
    homepage: str = ""
    settings: tuple[Setting, ...] = ()
    better: tuple[str, ...] = ()
    command: str = ""
    element: Element | None = None

    @property
    def is_outside(self) -> bool:
        """Whether it is somebody else's."""
        return self.element is None

    @property
    def adapters(self) -> dict[str, int]:
        """What runs it: files in the folder of adapters, by name, and how long each is."""
        names = [name for name in (self.adapter, self.motion) if name]
        return {name: len(_file_of(name).read_text("utf-8").splitlines()) for name in names}

    def command_line(self, *, is_motion: bool = False) -> str | None:
        """What is run; None where the simulator is not installed here."""
        if self.command:
            return self.command
        if self.program and shutil.which(self.program) is None:
            return None
        interpreter = interpreter_with(self.module) if self.module else sys.executable
        if interpreter is None:
            return None
        return f"{interpreter} {_file_of(self.adapter_for(is_motion))} {{case}} {{result}}"

    def adapter_for(self, is_motion: bool) -> str:
        """Which of its adapters takes a case."""
        return self.motion if is_motion and self.motion else self.adapter

    def why_missing(self) -> str:
        """What a reader does to have it."""
        where = "" if self.program else f" ({VARIABLE} names other interpreters)"
        return f"not installed here: {self.install}{where}"

    def sources_hash(self, *, is_motion: bool) -> str:
        """SHA-256 over what runs it: its adapter and the parts that it shares, or a command.

        Of a command also the files that it names; of an adapter the versions of what it runs.
        """
        adapter = self.adapter_for(is_motion)
        texts = _texts_of(adapter) if adapter else _texts_of_command(self.command)
        return hashlib.sha256(b"\0".join([*texts, self.versions().encode()])).hexdigest()

    def versions(self) -> str:
        """What is installed here of it, in its own words."""
        program = version_of_program(self.program) if self.program else ""
        interpreter = interpreter_with(self.module) if self.module else None
        if interpreter is None:
            return program
        return program + versions_with(interpreter, self.module, self.packages)


def _texts_of_command(command: str) -> list[bytes]:
    """A command line, and the files among its words."""
    files = [Path(word) for word in shlex.split(command)]
    return [command.encode(), *(file.read_bytes() for file in files if file.is_file())]


def _file_of(adapter: str) -> Path:
    return ADAPTERS / f"{adapter}.py"


@functools.cache
def _texts_of(adapter: str) -> list[bytes]:
    """An adapter's file and those of the folder that it imports, whoever imports them."""
    found: dict[str, bytes] = {}
    waiting = [adapter]
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if name in found or not file.is_file():
            continue
        found[name] = file.read_bytes()
        for node in ast.walk(ast.parse(found[name])):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                waiting.append(node.module)
    return [found[name] for name in sorted(found)]


OURS = tuple(
    Entry(
        name=f"fastsim-{element}",
        title=f"fastsim, {element}",
        element=element,
        homepage="",
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


def read_entries(path: Path = FILE) -> tuple[Entry, ...]:
    """Every entry of a file, in its order, and fastsim's last.

    Raises:
        FileFormatError: Missing, no TOML, a key that is not known, or two of one name.
    """
    try:
        given: dict[str, Any] = parse_toml(read_text(path))
        entries = TypeAdapter(tuple[Entry, ...]).validate_python(given.get("entry", ()))
    except (UntrustedTextError, ValidationError) as error:
        raise FileFormatError(path, f"no table of entries ({error})") from error
    everybody = (*entries, *OURS)
    if len({entry.name for entry in everybody}) < len(everybody):
        raise FileFormatError(path, "two entries of one name")
    return everybody


def chosen_entries(names: list[str] | None, everybody: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """Those that are named, in their order; all where none is.

    Raises:
        InputError: A name that is not there.
    """
    known = {entry.name for entry in everybody}
    for name in names or ():
        if name not in known:
            raise InputError(f"no entry {name!r} on the scoreboard; there are {', '.join(known)}")
    return tuple(entry for entry in everybody if not names or entry.name in names)
