"""`palpate law NAME`: is a law what it states, and are its derivatives right?"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT
from palpate.validation.commands.options import (
    Force,
    SimulatorCommand,
    TimeLimit,
    print_lines,
    progress_lines,
    write_json,
)
from palpate.validation.states import ExitCode

if TYPE_CHECKING:
    from palpate.meshes.problem import Material
    from palpate.validation.diagnosis.law_checks import Finding

_WHO = ("fastsim", "reference")


def law(
    name: Annotated[Law, typer.Argument(help="as in [material] law")],
    youngs_modulus: Annotated[float, typer.Option(help="at rest [Pa]")] = 1e4,
    poissons_ratio: Annotated[float, typer.Option(help="at rest [-]")] = 0.4,
    c01: Annotated[
        float | None, typer.Option(help="of mooney-rivlin [Pa]; default: a fifth of mu")
    ] = None,
    ogden: Annotated[
        list[str] | None,
        typer.Option(
            help="of ogden, once a term: its part of mu, its exponent; default: 0.7,1.3 "
            "0.2,5 0.1,-2"
        ),
    ] = None,
    who: Annotated[
        str, typer.Option("--with", help="whose law: fastsim, or reference (needs FEniCSx)")
    ] = "fastsim",
    simulator: SimulatorCommand = None,
    time_limit: TimeLimit = DEFAULT_TIME_LIMIT,
    limit: Annotated[
        float, typer.Option(help="of the stress of a simulator, over what was asked; its solver's")
    ] = 1e-5,
    self_test: Annotated[
        bool, typer.Option("--self-test", help="seed mistakes; each has to be seen")
    ] = False,
    json: Annotated[Path | None, typer.Option(help="file for the findings")] = None,
    force: Force = False,
) -> None:
    """Check energy, stress and tangent of a law, deformation by deformation.

    Of another simulator the stress alone, by bodies of single cells that it brings to rest.
    """
    from palpate.validation.candidates.outside import OutsideSimulator
    from palpate.validation.diagnosis import law_checks as checks
    from palpate.validation.diagnosis.law_simulators import (
        FastsimLaw,
        ReferenceLaw,
        example_material,
    )
    from palpate.validation.output_files import require_outputs

    if who not in _WHO:
        raise InputError(f"--with {who}: use {' or '.join(_WHO)}")
    if not 0.0 < limit < 1.0:
        raise InputError(f"--limit {limit:g}: needs a value above 0 and below 1")
    if simulator is not None and self_test:
        raise InputError("--self-test seeds mistakes in palpate's own laws; leave --simulator out")
    require_outputs({"--json": json}, force=force)
    material = example_material(name, poissons_ratio, youngs_modulus)
    if c01 is not None:
        material = dataclasses.replace(material, c01=c01)
    if ogden is not None:
        material = dataclasses.replace(material, ogden_terms=_ogden_terms(ogden))
    if simulator is not None:
        program = OutsideSimulator(simulator, time_limit)
        found = checks.check_simulator(program, material, limit, progress_lines())
        _end(material, program.name, found, json, _of_cells(material, found))
        return
    whose = FastsimLaw(material) if who == "fastsim" else ReferenceLaw(material)
    if not self_test:
        remarks = (
            []
            if material.law.is_finite_when_inverted
            else ["inverted cells: not asked, this law has no stress where det F <= 0"]
        )
        _end(material, whose.name, checks.check_law(whose, material), json, remarks)
        return
    caught = checks.self_test(whose, material)
    for mistake, findings in caught.items():
        says = f"seen by {findings[0].check}: {findings[0].message}" if findings else "NOT SEEN"
        print_lines([f"{mistake}: {says}"])
    write_json(json, {name: bool(found) for name, found in caught.items()})
    if not all(caught.values()):
        raise typer.Exit(ExitCode.FAILED)


def _ogden_terms(given: list[str]) -> tuple[tuple[float, float], ...]:
    """The terms of Ogden's law from the command line."""
    try:
        terms = [tuple(float(number) for number in of.split(",")) for of in given]
        return tuple((part, alpha) for part, alpha in terms)
    except ValueError:
        raise InputError(f"--ogden {' '.join(given)}: each is two numbers, like 0.7,1.3") from None


def _of_cells(material: Material, found: list[Finding]) -> list[str]:
    """Which of a simulator's cells came to rest inside out, and which were not asked for."""
    from palpate.validation.diagnosis.law_checks import asked_of_simulators

    inverted = {f"{each.kind.rstrip(' 0123456789')} {k}" for each in found for k in each.inverted}
    _, kinds, numbers, is_stable = asked_of_simulators(material)
    every = [f"{kind} {number}" for kind, number in zip(kinds, numbers, strict=True)]
    where = [name for name in every if name in inverted]
    lines = [
        f"inverted: {', '.join(where)}: came to rest inside out (det F < 0)"
        if where
        else "no cell came to rest inside out"
    ]
    left = [name for name, stays in zip(every, is_stable, strict=True) if not stays]
    if left:
        lines.append(
            f"left out: {', '.join(left)}: a free cell of this material does not stay there under "
            "dead forces"
        )
    return lines


def _end(
    material: Material, who: str, found: list[Finding], json: Path | None, remarks: list[str]
) -> None:
    """Print the findings, write them, and end with the exit code of the worst."""
    about = f"E = {material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}"
    lines = [f"{material.law}, {about}, by {who}"]
    for each in found:
        error = f"{each.error:9.2e} <= {each.limit:g}"
        verdict = "passed" if each.is_good else "FAILED"
        lines.append(f"  {each.check:16} {each.kind:16} {error}  {verdict}")
    wrong = [each for each in found if not each.is_good]
    for each in wrong:
        lines.append(f"failed: {each.check}, {each.kind}: {each.message}")
        failed = ", ".join(map(str, each.failed))
        lines.append(
            f"  at number {failed} of the kind; the worst F = {each.worst.round(6).tolist()}"
        )
    lines += remarks
    causes = {each.message for each in wrong if each.check == "law as stated"}
    number = f"{len(wrong)} of {len(found)}" if wrong else f"{len(found)}"
    verdict = f"{'FAILED' if wrong else 'passed'}: {number} checks"
    lines.append(verdict + (f"; {causes.pop()}" if len(causes) == 1 else ""))
    print_lines(lines)
    rows = [
        {
            "check": each.check,
            "kind": each.kind,
            "error": each.error,
            "limit": each.limit,
            "verdict": "passed" if each.is_good else "failed",
            "worst": each.worst.tolist(),
            "failed": list(each.failed),
            "inverted": list(each.inverted),
            "message": each.message,
        }
        for each in found
    ]
    write_json(json, {"law": material.law.value, "of": who, "findings": rows, "remarks": remarks})
    if wrong:
        raise typer.Exit(ExitCode.FAILED)
