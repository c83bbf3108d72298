"""The command line: `palpate ...`. It only calls what can be called from Python."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.validation.candidates.faults import Fault
from palpate.validation.commands import case_files, judging, reference, solve, studies
from palpate.validation.commands.endings import (
    end_by,
    end_of,
    end_soon,
    outlive_readers,
    quiet_archives,
    stoppable,
)
from palpate.validation.commands.fit import fit
from palpate.validation.commands.history import history
from palpate.validation.commands.law import law
from palpate.validation.commands.mesh import mesh
from palpate.validation.commands.options import listed
from palpate.validation.states import ExitCode
from palpate.validation.studies import STUDIES
from palpate.validation.versions import version_lines

app = typer.Typer(name="palpate", no_args_is_help=True, pretty_exceptions_enable=False)
app.add_typer(reference.app, name="reference")


def _print_version(is_asked: bool) -> None:
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


app.command()(case_files.cases)
app.command()(case_files.init)
app.command("import")(case_files.import_model)
app.command()(case_files.schema)
app.command()(case_files.check)
app.command()(mesh)
app.command()(case_files.export)
app.command()(judging.compare)
app.command("compare-runs")(judging.compare_runs)
app.command()(solve.audit)
app.command()(law)
app.command()(solve.solve)
app.command()(studies.sweep)
app.command()(fit)
app.command()(studies.touch)
_faults = listed("Faults:", ((fault.value, fault.meaning) for fault in Fault))
app.command(help=f"{judging.gate.__doc__}\n\n{_faults}")(judging.gate)
app.command()(judging.report)
_studies = listed("Studies:", STUDIES.items())
app.command(help=f"{studies.study.__doc__}\n\n{_studies}")(studies.study)
app.command()(studies.bench)
app.command()(studies.scoreboard)
app.command()(history)


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
