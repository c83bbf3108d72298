"""The command line: `palpate ...`. It only calls what can be called from Python."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from palpate.validation.candidates.faults import Fault
from palpate.validation.commands import reference as reference_cli
from palpate.validation.commands.audit import audit
from palpate.validation.commands.bench import bench
from palpate.validation.commands.check import check
from palpate.validation.commands.compare_runs import compare_runs
from palpate.validation.commands.endings import end_by, end_of, outlive_readers, stoppable
from palpate.validation.commands.exchange import compare, export
from palpate.validation.commands.gate import gate
from palpate.validation.commands.importing import import_model
from palpate.validation.commands.law import law
from palpate.validation.commands.mesh import mesh
from palpate.validation.commands.new_case import init, schema
from palpate.validation.commands.report import report
from palpate.validation.commands.scoreboard import scoreboard
from palpate.validation.commands.solve import solve
from palpate.validation.commands.study import study
from palpate.validation.commands.sweep import sweep
from palpate.validation.commands.touch import touch
from palpate.validation.commands.words import listed
from palpate.validation.quoting import for_terminal
from palpate.validation.states import ExitCode
from palpate.validation.studies import STUDIES
from palpate.validation.versions import version_lines

app = typer.Typer(name="palpate", no_args_is_help=True, pretty_exceptions_enable=False)
app.add_typer(reference_cli.app, name="reference")


def _tell_version(is_asked: bool) -> None:
    if is_asked:
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
            callback=_tell_version,
            is_eager=True,
            help="tell it, and those of its parts",
        ),
    ] = False,
) -> None:
    """Judge fast soft-tissue simulators against a FEniCSx reference."""


@app.command()
def cases() -> None:
    """List the built-in cases, one line each."""
    from palpate.validation.case import builtin_cases, load_case

    for name in builtin_cases():
        print(for_terminal(f"{name:12} {load_case(name).title}"))


app.command()(init)
app.command("import")(import_model)
app.command()(schema)
app.command()(check)
app.command()(mesh)
app.command()(export)
app.command()(compare)
app.command("compare-runs")(compare_runs)
app.command()(audit)
app.command()(law)
app.command()(solve)
app.command()(sweep)
app.command()(touch)
_faults = listed("Faults:", ((fault.value, fault.meaning) for fault in Fault))
app.command(help=f"{gate.__doc__}\n\n{_faults}")(gate)
app.command()(report)
app.command(help=f"{study.__doc__}\n\n{listed('Studies:', STUDIES.items())}")(study)
app.command()(bench)
app.command()(scoreboard)


def main() -> None:
    """Run the command line; every end has its exit code, and no traceback looks like a verdict.

    Under mpirun the first process does; the others do their share of what it solves.
    """
    from palpate.reference import ranks

    if ranks.is_follower():
        sys.exit(ranks.follow())
    outlive_readers()
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
        return end_by(stop.number)
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    main()
