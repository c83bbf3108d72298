"""Arguments, options, lines of help and progress, and output that several verbs share."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Element, Strain
from palpate.meshes.rigid_tool import ContactRule
from palpate.reference.schemes import Integrator
from palpate.validation.quoting import for_json, for_terminal
from palpate.validation.solving import Simulator
from palpate.validation.states import Elements, Precision, Progress
from palpate.validation.versions import version_of

if TYPE_CHECKING:
    from palpate.fastsim.critical_cells import CriticalCells
    from palpate.meshes.arrays import Points

# E [Pa], nu, density [kg/m3] where no material is stated: a step then stands for a length over the
# speed of pressure waves.
TISSUE = (1e4, 0.45, 1000.0)


def is_condensed(simulator: Simulator) -> bool:
    """Whether fastsim's condensed model is judged, and not fastsim itself.

    Raises:
        InputError: The reference, which is what others are compared with.
    """
    if simulator is Simulator.REFERENCE:
        raise InputError("--with reference: the reference is no candidate; take fastsim's engines")
    return simulator is Simulator.CONDENSED


def near_tool_metres(edge: float | None) -> float | None:
    """The length of --near-tool-edge in metres.

    Raises:
        InputError: It is not above 0.
    """
    if edge is not None and not (math.isfinite(edge) and edge > 0.0):
        raise InputError(f"--near-tool-edge {edge:g}: needs a finite length above 0, in mm")
    return None if edge is None else edge * 1e-3


def complete_case(incomplete: str) -> list[str]:
    """Built-in cases that begin with this text, for the shell, which completes files itself."""
    from palpate.validation.case import builtin_cases

    return [name for name in builtin_cases() if name.startswith(incomplete)]


OneCase = Annotated[
    str, typer.Argument(help="built-in name, or path to a .toml file", autocompletion=complete_case)
]
OptionalCases = Annotated[
    list[str] | None,
    typer.Argument(help="built-in names, or paths to .toml files", autocompletion=complete_case),
]
Folder = Annotated[Path, typer.Option("--output", "-o", help="folder for the results")]
OptionalFile = Annotated[Path | None, typer.Option()]
Force = Annotated[
    bool, typer.Option("--force", help="replace output files that palpate did not write, too")
]
Expected = Annotated[
    bool, typer.Option(help="1 where a built-in verdict is not the one expected of fastsim")
]
Live = Annotated[bool, typer.Option(help="solve the reference here")]
ResultFile = typer.Argument(help="displacement as .vtu, .npz or .csv")
StrainOfCase = Annotated[Strain | None, typer.Option(help="default: the case's")]
ChosenElements = Annotated[
    Elements | None,
    typer.Option(
        "--element",
        help="of fastsim's tetrahedra; both: beside one another; of another simulator the one that "
        "it is judged by, whatever its result states",
    ),
]
ChosenEngine = Annotated[
    Simulator,
    typer.Option(
        "--with",
        help="condensed: fastsim's condensed linear model; linear strain; stored in the folder "
        "that PALPATE_CONDENSED names",
    ),
]
Device = Annotated[
    str,
    typer.Option(
        help="of fastsim's explicit steps: cpu is the compiled core; cuda:0 or warp:cpu need the "
        "extra gpu"
    ),
]
NearTool = Annotated[
    bool,
    typer.Option(
        "--near-tool",
        help="a mesh with small cells where tools press; the reference is solved here",
    ),
]
NearToolEdge = Annotated[
    float | None,
    typer.Option(help="length of edges there in mm; else half of the radius of contact"),
]
ElementOfResult = Annotated[
    Element | None, typer.Option(help="that the result is judged by; default: linear")
]
SimulatorCommand = Annotated[
    str | None, typer.Option(help='judge another simulator: "mysim {case} {result}"')
]
TimeLimit = Annotated[float, typer.Option(help="of the simulator, in seconds")]
AskedIntegrator = Annotated[
    Integrator | None,
    typer.Option(help="that it is judged by; default: the case's central differences"),
]
AskedTimeStep = Annotated[
    float | None, typer.Option(help="[s] that it is asked for and judged by, not the case's")
]
AskedLaws = Annotated[
    list[Law] | None,
    typer.Option("--law", help="instead of the case's; repeatable; the reference is solved here"),
]
AskedContact = Annotated[
    ContactRule | None,
    typer.Option("--contact", help="of every tool, not the case's; the reference is solved here"),
]
ToldIterations = Annotated[
    int | None, typer.Option(help="for {iterations} in the simulator's command")
]
GrantedPrecision = Annotated[
    Precision | None, typer.Option(help="granted to the results; default: what the case grants")
]


def progress_lines() -> Progress:
    """A function that prints one dim line."""
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:  # a log has many lines, and no layout
        return lambda line: print(f"  {for_terminal(line)}", file=sys.stderr, flush=True)
    return lambda line: console.print(Text(f"  {for_terminal(line)}", style="dim"), soft_wrap=True)


def print_lines(lines: Iterable[str], prefix: str = "") -> None:
    """Print texts of others on standard output, each on a line."""
    for line in lines:
        print(for_terminal(f"{prefix}{line}"))


def step_lines(
    critical: CriticalCells, *, is_stated: bool, scale: float, unit: str
) -> Iterator[str]:
    """Lines on the critical step, and the cells that determine it.

    Args:
        critical: Critical cells of the mesh.
        is_stated: Whether the material is the user's; otherwise steps are lengths over c.
        scale: Metres per unit of the file.
        unit: Name of this unit.
    """

    def shown(step: float) -> str:
        if is_stated:
            return f"{step:.4g} s"
        return f"{step * critical.wave_speed / scale:.4g} {unit} / c"

    which = "" if is_stated else " (c: speed of pressure waves, Poisson's ratio 0.45)"
    yield f"critical time step {shown(critical.time_step)}{which}, decided by"
    for cell, step, point in zip(critical.cells, critical.steps, critical.positions, strict=True):
        yield f"  cell {cell} at {place_of(point, scale)}: {shown(step)}"
    yield (
        f"  the thinnest facet, at {place_of(critical.surface_place, scale)}, allows at most "
        f"{shown(critical.surface_step)}"
    )


def place_of(point: Points, scale: float) -> str:
    """A position in units of `scale` [m]."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*(float(x) / scale for x in point))


def write_json(path: Path | None, document: dict[str, Any]) -> None:
    """Write strict JSON, whole or not at all; nothing where no file was asked for."""
    from palpate.meshes.own_files import write_own_text

    if path is not None:
        own = {"palpate": version_of("palpate"), **document}
        write_own_text(path, json.dumps(for_json(own), indent=2, allow_nan=False) + "\n")
