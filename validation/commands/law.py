"""`palpate law NAME`: is a law what it states, and are its derivatives right?"""

from __future__ import annotations

import dataclasses
import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.validation.candidates.outside import DEFAULT_TIME_LIMIT
from palpate.validation.commands.words import SimulatorCommand, TimeLimit, progress_lines
from palpate.validation.quoting import for_json, for_terminal
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
) -> None:
    """Check energy, stress and tangent of a law, deformation by deformation.

    Of another simulator the stress alone, by bodies of single cells that it brings to rest.
    """
    from palpate.meshes.atomic_write import write_text_atomically
    from palpate.validation.candidates.outside import OutsideSimulator
    from palpate.validation.diagnosis import law_checks as checks
    from palpate.validation.diagnosis.law_outside import check_simulator
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
    require_outputs({"--json": json})
    material = example_material(name, poissons_ratio, youngs_modulus)
    if c01 is not None:
        material = dataclasses.replace(material, c01=c01)
    if ogden is not None:
        material = dataclasses.replace(material, ogden_terms=_ogden_terms(ogden))
    if simulator is not None:
        program = OutsideSimulator(simulator, time_limit)
        found = check_simulator(program, material, limit, progress_lines())
        _end(material, program.name, found, json)
        return
    whose = FastsimLaw(material) if who == "fastsim" else ReferenceLaw(material)
    if not self_test:
        _end(material, whose.name, checks.check_law(whose, material), json)
        return
    caught = checks.self_test(whose, material)
    for mistake, findings in caught.items():
        says = f"seen by {findings[0].check}: {findings[0].message}" if findings else "NOT SEEN"
        print(for_terminal(f"{mistake}: {says}"))
    if json is not None:
        text = json_format.dumps({name: bool(found) for name, found in caught.items()}, indent=2)
        write_text_atomically(json, text + "\n")
    if not all(caught.values()):
        raise typer.Exit(ExitCode.FAILED)


def _ogden_terms(given: list[str]) -> tuple[tuple[float, float], ...]:
    """By what was given on the command line."""
    try:
        terms = [tuple(float(number) for number in of.split(",")) for of in given]
        return tuple((share, alpha) for share, alpha in terms)
    except ValueError:
        raise InputError(f"--ogden {' '.join(given)}: each is two numbers, like 0.7,1.3") from None


def _end(material: Material, who: str, found: list[Finding], json: Path | None) -> None:
    """Tell the findings, write them, and end by the worst."""
    from palpate.meshes.atomic_write import write_text_atomically

    print(for_terminal(f"{material.law}, E = {material.youngs_modulus:g} Pa, "
                       f"nu = {material.poissons_ratio:g}, by {who}"))  # fmt: skip
    for finding in found:
        verdict = "passed" if finding.is_good else "FAILED"
        line = f"{finding.check:16} {finding.kind:16} {finding.error:9.2e} <= {finding.limit:g}"
        print(for_terminal(f"  {line}  {verdict}"))
    wrong = [finding for finding in found if not finding.is_good]
    for finding in wrong:
        print(for_terminal(f"failed: {finding.check}, {finding.kind}: {finding.message}"))
        print(for_terminal(f"  at F = {finding.worst.round(6).tolist()}"))
    if json is not None:
        rows = [
            {
                "check": finding.check,
                "kind": finding.kind,
                "error": finding.error,
                "limit": finding.limit,
                "verdict": "passed" if finding.is_good else "failed",
                "worst": finding.worst.tolist(),
                "message": finding.message,
            }
            for finding in found
        ]
        document = {"law": material.law.value, "of": who, "findings": rows}
        write_text_atomically(json, json_format.dumps(for_json(document), indent=2) + "\n")
    if wrong:
        raise typer.Exit(ExitCode.FAILED)
