"""`palpate reference build|check|accept`: stored references, and who accepted them."""

from __future__ import annotations

import datetime
import getpass
import math
import os
import random
import secrets
import time
from collections.abc import Callable
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.commands.options import print_lines, progress_lines
from palpate.validation.output_files import require_reference_file
from palpate.validation.states import ExitCode, gravest
from palpate.validation.versions import version_of

if TYPE_CHECKING:
    from palpate.validation.case import Case
    from palpate.validation.references.reference_set import ReferenceSet

app = typer.Typer(help="Stored references.", no_args_is_help=True, add_completion=False)

Cases = Annotated[
    list[str] | None,
    typer.Argument(help="built-in names, or .toml files; all built-in ones where none is named"),
]


UnderLaw = Annotated[
    Law | None, typer.Option(help="of the same bodies under this law, for `gate --law`")
]


def _under(name: str, law: Law | None) -> Case:
    from palpate.validation.case import load_case

    case = load_case(name)
    return case if law is None else case.under(law)


def _stored_cases(name: str) -> list[Case]:
    """The case, and the same under each other law for which a reference is stored."""
    from palpate.validation.case import load_case
    from palpate.validation.references.stored import accepted_path

    case = load_case(name)
    laws = [law for law in Law if law is not case.spec.material.law]
    is_there = [accepted_path(f"{case.name}-{law}", case.beside).is_file() for law in laws]
    return [case, *(case.under(law) for law in compress(laws, is_there))]


def _chosen(names: list[str] | None) -> list[str]:
    from palpate.validation.case import builtin_cases

    return names or list(builtin_cases())


def _print_each(names: list[str], lines: Callable[[Case, str, Path], list[str]]) -> None:
    """Print the lines on each case's accepted reference; all refusals come last."""
    from palpate.validation.references.stored import accepted_path

    troubles = []
    for name, case in ((of, case) for of in names for case in _stored_cases(of)):
        try:
            found = lines(case, name, accepted_path(case.name, case.beside))
        except InputError as error:
            troubles.append(str(error))
            continue
        print_lines(found)
    if troubles:
        raise InputError("; ".join(troubles))


def _processor_seconds() -> float:
    """Processor time of this process and its ended children [s]."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


@app.command()
def build(
    names: Cases = None,
    law: UnderLaw = None,
    same_mesh: Annotated[
        bool,
        typer.Option("--same-mesh", help="only what is on the case's mesh; the truth as stored"),
    ] = False,
) -> None:
    """Solve references and put them beside the accepted ones, to be accepted; needs FEniCSx."""
    from palpate.validation.judging.case_references import truth_request
    from palpate.validation.references.geometry import with_geometry
    from palpate.validation.references.statics import solve_for_storing, solve_same_mesh_again
    from palpate.validation.references.stored import (
        accepted_path,
        pending_path,
        read_for,
    )

    option = "" if law is None else f" --law {law}"
    for name in _chosen(names):
        case = _under(name, law)
        require_reference_file(pending_path(case.name, case.beside))
        request = truth_request(case)
        progress = progress_lines()
        clock, processor = time.perf_counter(), _processor_seconds()
        if same_mesh:
            path = accepted_path(case.name, case.beside)
            found = solve_same_mesh_again(case.problem, read_for(case.problem, path), progress)
            record = {
                "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
                "command": f"palpate reference build {case.path.stem}{option} --same-mesh",
                "palpate": version_of("palpate"),
            }
            _put_beside(case, found, {**found.provenance, "same_mesh": record}, option)
            continue
        found = solve_for_storing(
            case.problem,
            progress,
            wanted={spec.against for spec in case.checks},
            truth_strains=sorted({s.strain or case.strain for s in case.checks}),
            request=request,
        )
        judged = {s.strain or case.strain for s in case.checks if s.against == "truth"}
        found = with_geometry(
            case, found, progress, strains=judged, request=request, is_for_storing=True
        )
        provenance: dict[str, Any] = {
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "command": f"palpate reference build {case.path.stem}{option}",
            "palpate": version_of("palpate"),
            **found.provenance,
            "seconds": round(time.perf_counter() - clock, 1),
            "processor_seconds": round(_processor_seconds() - processor, 1),
        }
        _put_beside(case, found, provenance, option)


def _put_beside(case: Case, found: ReferenceSet, provenance: dict[str, Any], option: str) -> None:
    """Store what was built, to be accepted, and print what it changes."""
    from palpate.validation.references.stored import (
        accepted_path,
        describe_changes,
        pending_path,
        store,
    )

    path = pending_path(case.name, case.beside)
    store(case.name, case.problem, found, provenance, path=path)
    print(path)
    print_lines(describe_changes(accepted_path(case.name, case.beside), path), "  ")
    print(f"  not used before `palpate reference accept {case.called}{option} --reason TEXT`")


@app.command()
def check(
    names: Cases = None,
    solve: Annotated[
        bool, typer.Option("--solve", help="solve some of them anew, and compare; needs FEniCSx")
    ] = False,
    cases: Annotated[
        int | None,
        typer.Option(min=1, help="of --solve: how many, by chance; 3, or all that are named"),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="of --solve: the same choice again")] = None,
    time_limit: Annotated[
        float, typer.Option(help="of --solve: for each truth, and run of a motion, in seconds")
    ] = 120.0,
) -> None:
    """Check all that can be checked of accepted references; exit code 2 where one is refused.

    The hash, that they belong to their case, header numbers, supports, times, equilibrium, every
    step of a motion on the same mesh, error bars by the record that explains them, that a truth is
    not the solution on the case's own mesh, who made and who accepted them. A file that was forged
    with all of this passes: --solve solves anew, and ends with 1 where the file differs by more
    than rounding and error bars, with 3 where a state could not be solved in time.
    """
    from palpate.validation.references.stored import (
        describe_acceptance,
        describe_time,
        load_checked,
    )

    def lines(case: Case, name: str, path: Path) -> list[str]:
        stored = load_checked(path, case.name, case.problem, name, thoroughly=True)
        accepted = describe_acceptance(stored)
        if not accepted:
            raise InputError(
                f"the stored reference of {case.name!r} does not say who accepted it, when and "
                f"why: `palpate reference build {name}`, then accept what that made"
            )
        date = stored.provenance.get("date", "?")
        made = f"{case.name}: {stored.origin}, made {date}{describe_time(stored)}"
        return [made, f"  {accepted}"]

    if not solve and (cases, seed) != (None, None):
        raise InputError("--cases and --seed are of --solve: add it, or leave them out")
    if not 0.0 < time_limit < math.inf:
        raise InputError(f"--time-limit {time_limit:g}: needs a finite value above 0")
    everybody = _chosen(names)
    _print_each(everybody, lines)
    if solve:
        seed = secrets.randbelow(10**6) if seed is None else seed
        count = min(cases or (len(everybody) if names else 3), len(everybody))
        chosen = random.Random(seed).sample(everybody, count)
        print_lines([f"solved anew (--seed {seed}): {', '.join(chosen)}"])
        _solve_anew(chosen, time_limit)


def _solve_anew(names: list[str], seconds: float) -> None:
    """Compare stored references with what is solved here; the exit code is the gravest."""
    from palpate.validation.case import load_case
    from palpate.validation.judging.case_references import truth_request
    from palpate.validation.references.solved_again import compare_anew
    from palpate.validation.references.stored import accepted_path, load_checked

    verdicts = []
    for name in names:
        case = load_case(name)
        path = accepted_path(case.name, case.beside)
        stored = load_checked(path, case.name, case.problem, name)
        request = truth_request(case)
        found = compare_anew(case.problem, stored, request, seconds, progress_lines())
        print_lines([f"{case.name}: {each.verdict}: {each}" for each in found])
        verdicts += [each.verdict for each in found]
    code = ExitCode[gravest(verdicts).name]
    if code is not ExitCode.PASSED:
        raise typer.Exit(code)


@app.command()
def accept(
    names: Annotated[list[str], typer.Argument(help="built-in names, or .toml files")],
    reason: Annotated[str, typer.Option(help="why the new one is right; stored with it")],
    by: Annotated[str | None, typer.Option(help="who says so; default: the user's name")] = None,
    law: UnderLaw = None,
) -> None:
    """Make what was built the reference, and keep who said so, why, and what changed."""
    from palpate.validation.references.stored import (
        accept_pending,
        accepted_path,
        describe_changes,
        pending_path,
    )

    if not reason.strip():
        raise InputError("--reason is empty; say why the new reference is right")
    for name in names:
        case = _under(name, law)
        pending = pending_path(case.name, case.beside)
        require_reference_file(accepted_path(case.name, case.beside))
        changes = describe_changes(accepted_path(case.name, case.beside), pending)
        acceptance = {
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "by": by or getpass.getuser(),
            "reason": reason.strip(),
            "changes": changes,
        }
        print(accept_pending(case.name, case.problem, acceptance, beside=case.beside))
        print_lines(changes, "  ")
