"""The command line: `palpate ...`. It only calls what can be called from Python."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from palpate.meshes.errors import InputError
from palpate.validation.commands.endings import (
    end_by,
    end_of,
    end_soon,
    outlive_readers,
    quiet_archives,
    stoppable,
)
from palpate.validation.quoting import listed
from palpate.validation.states import ExitCode

# Every command, in the order of --help, and the function in `commands` that it is; reference has
# commands of its own.
_COMMANDS = {
    "cases": "case_files.cases",
    "init": "case_files.init",
    "import": "case_files.import_model",
    "schema": "case_files.schema",
    "check": "case_files.check",
    "mesh": "mesh.mesh",
    "export": "case_files.export",
    "compare": "judging.compare",
    "compare-runs": "judging.compare_runs",
    "audit": "solve.audit",
    "law": "law.law",
    "solve": "solve.solve",
    "sweep": "studies.sweep",
    "fit": "fit.fit",
    "touch": "studies.touch",
    "gate": "judging.gate",
    "report": "judging.report",
    "study": "studies.study",
    "bench": "studies.bench",
    "scoreboard": "studies.scoreboard",
    "history": "history.history",
    "reference": "reference.app",
}


class _Loaded(Mapping[str, Any]):
    """Commands by name; the module of one is loaded when that is asked for, and no other."""

    def __getitem__(self, name: str) -> Any:
        module, _, function = _COMMANDS[name].partition(".")
        found = getattr(importlib.import_module(f"palpate.validation.commands.{module}"), function)
        if not isinstance(found, typer.Typer):
            one = typer.Typer(add_completion=False)
            one.command(name, help=found.__doc__)(found)
            found = one
        command = typer.main.get_command(found)
        command.name = name
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(_COMMANDS)

    def __len__(self) -> int:
        return len(_COMMANDS)


class _Commands(TyperGroup):
    """The commands of palpate, loaded one by one."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**(attributes | {"commands": {}}))
        self.commands: Any = _Loaded()

    def list_commands(self, _context: Any, /) -> list[str]:
        """Their names, without loading them."""
        return list(_COMMANDS)


app = typer.Typer(
    name="palpate", cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from palpate.validation.versions import version_lines

        print("\n".join(version_lines()))
        raise typer.Exit


_ends = [(str(int(code)), code.meaning) for code in ExitCode]
_ends.append(("128+N", "ended by signal N"))


@app.callback(epilog=listed("Exit codes:", _ends))
def palpate(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="print it, and those of its parts",
        ),
    ] = False,
) -> None:
    """Judge fast soft-tissue simulators against a FEniCSx reference."""
    try:
        Path.cwd()
    except OSError as error:
        raise InputError(
            f"the working folder cannot be used ({error.strerror}): go to another"
        ) from None


def main() -> None:
    """Run the command line; every end has its exit code, and no traceback looks like a verdict.

    Under mpirun the first process runs it; the others do their part of what it solves.
    """
    from palpate.reference import ranks

    if ranks.is_follower():
        sys.exit(ranks.follow())
    outlive_readers()
    quiet_archives()
    code = int(ExitCode.INTERNAL_ERROR)
    try:
        code = _lead()
    finally:
        ranks.dismiss(code)
    sys.exit(code)


def _lead() -> int:
    with stoppable() as stop:
        try:
            code = app(standalone_mode=False)
            sys.stdout.flush()
        except (Exception, KeyboardInterrupt) as error:
            if stop.number is None:
                return end_of(error)
    if stop.number is not None:
        end_soon(stop.number)
        return end_by(stop.number)
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    main()
