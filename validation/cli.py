"""The command line: `palpate ...`. It only calls what can be called from Python."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback

import typer

from palpate.meshes.errors import InputError
from palpate.validation.commands import reference as reference_cli
from palpate.validation.commands.audit import audit
from palpate.validation.commands.bench import bench
from palpate.validation.commands.exchange import compare, export
from palpate.validation.commands.gate import gate
from palpate.validation.commands.mesh import mesh
from palpate.validation.commands.report import report
from palpate.validation.commands.solve import solve
from palpate.validation.commands.study import study

# Exit codes, the same for every verb (README).
USAGE, INTERNAL = 2, 4

app = typer.Typer(
    name="palpate",
    help="Judge fast soft-tissue simulators against a FEniCSx reference.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(reference_cli.app, name="reference")


@app.command()
def cases() -> None:
    """List the built-in cases, one line each."""
    from palpate.validation.case import builtin_cases, load_case

    for name in builtin_cases():
        print(f"{name:12} {load_case(name).title}")


app.command()(mesh)
app.command()(export)
app.command()(compare)
app.command()(audit)
app.command()(solve)
app.command()(gate)
app.command()(report)
app.command()(study)
app.command()(bench)


def main() -> None:
    """Run the command line; every end has its exit code, and no traceback looks like a verdict.

    Under mpirun the first process does; the others do their share of what it solves.
    """
    from palpate.reference import ranks

    if ranks.is_follower():
        sys.exit(ranks.follow())
    try:
        _lead()
    finally:
        ranks.dismiss()


def _lead() -> None:
    try:
        code = app(standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except (KeyboardInterrupt, typer.Abort):
        print("palpate: stopped; nothing half-written was left", file=sys.stderr)
        sys.exit(130)
    except InputError as error:
        print(f"palpate: {error}", file=sys.stderr)
        sys.exit(USAGE)
    except OSError as error:
        print(f"palpate: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        sys.exit(USAGE)
    except Exception as error:
        sys.exit(_other_end(error))


def _other_end(error: Exception) -> int:
    """Usage errors of the command line, a reference that failed, or an error of palpate's own."""
    # typer brings its own copy of click or the real one: known by what they can do.
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        print(f"palpate: {error.format_message()}", file=sys.stderr)
        return USAGE
    from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError

    if isinstance(error, ReferenceUnavailableError):
        print(f"palpate: {error}", file=sys.stderr)
        return USAGE
    if isinstance(error, ReferenceFailedError):
        print(f"palpate: {error}", file=sys.stderr)
        return 3
    handle, name = tempfile.mkstemp(prefix="palpate-error-", suffix=".txt", text=True)
    with os.fdopen(handle, "w", encoding="utf-8") as stream:
        traceback.print_exception(error, file=stream)
    print(f"palpate: internal error: {type(error).__name__}: {error} ({name})", file=sys.stderr)
    return INTERNAL


if __name__ == "__main__":
    main()
