"""The rooms keep to their place: who may import whom, and how long a file may be."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path
from types import FrameType

import pytest

import palpate
from palpate.validation.judging.case_references import find_references
from palpate.validation.judging.checks import CaseJudge
from palpate.validation.metrics import make_state
from palpate.validation.states import Verdict, in_silence

ROOT = Path(__file__).parent.parent
ROOMS = ("meshes", "fastsim", "reference", "validation")
# What each room may not import: other rooms, and libraries that belong elsewhere.
FORBIDDEN = {
    "meshes": {
        "palpate.fastsim", "palpate.reference", "palpate.validation",
        "dolfinx", "ufl", "petsc4py", "pyvista",
    },
    "fastsim": {
        "palpate.reference", "palpate.validation",
        "dolfinx", "ufl", "petsc4py", "gmsh", "scipy", "tetgen", "pytetwild", "pyvista", "meshio",
    },
    "reference": {"palpate.fastsim", "palpate.validation", "gmsh"},
    "validation": set(),
}  # fmt: skip
MOST_LINES = 600
# Of the reference: plain Python, importable where there is no FEniCSx.
LIGHT = ("availability", "errors", "schemes", "result")


def imported_names(source: str) -> list[str]:
    """Every module a source text imports, wherever in it."""
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.append(node.module)
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level > 0:
            names.append("(relative)")
    return names


def violations(room: str, source: str) -> list[str]:
    """Imports of a source text that its room may not make."""
    bad = []
    for name in imported_names(source):
        parts = [".".join(name.split(".")[: k + 1]) for k in range(name.count(".") + 1)]
        if FORBIDDEN[room] & set(parts) or name.split(".")[0] in ROOMS or name == "(relative)":
            bad.append(name)
    return bad


def eager_imports(source: str) -> set[str]:
    """Modules imported when the file itself is imported."""
    names: set[str] = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def python_files(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


@pytest.mark.parametrize("room", ROOMS)
def test_imports_run_one_way(room: str) -> None:
    files = python_files(room)
    assert files
    bad = {str(f.relative_to(ROOT)): violations(room, f.read_text("utf-8")) for f in files}
    assert {name: names for name, names in bad.items() if names} == {}


@pytest.mark.parametrize(
    ("room", "source"),
    [
        ("fastsim", "import palpate.reference.statics"),
        ("fastsim", "def f():\n    from palpate import validation"),
        ("fastsim", "import gmsh"),
        ("reference", "from palpate.fastsim import forces"),
        ("meshes", "from palpate.fastsim.forces import det_f"),
        ("validation", "import fastsim"),
        ("validation", "from . import case"),
    ],
)
def test_a_forbidden_import_is_seen(room: str, source: str) -> None:
    assert violations(room, source)


def test_the_judge_imports_the_solver_side_of_the_reference_only_when_it_needs_it() -> None:
    light = {f"palpate.reference.{name}" for name in LIGHT}
    for file in python_files("validation"):
        names = {n for n in eager_imports(file.read_text("utf-8")) if "reference." in n}
        names = {n for n in names if n.startswith("palpate.reference")}
        assert names <= light, file


def test_only_one_place_of_the_simulator_knows_warp_and_not_before_it_is_needed() -> None:
    users = {
        file.relative_to(ROOT).parts[:2]
        for room in ("meshes", "fastsim", "reference")
        for file in python_files(room)
        if any(name.split(".")[0] == "warp" for name in imported_names(file.read_text("utf-8")))
    }
    assert users == {("fastsim", "gpu")}
    for file in python_files("fastsim/gpu"):
        assert not {n for n in eager_imports(file.read_text("utf-8")) if n.startswith("warp")}


@pytest.mark.parametrize("room", ["meshes", "reference", "validation"])
def test_scipy_is_imported_when_it_is_needed_and_not_before(room: str) -> None:
    for file in python_files(room):
        if "adapters" in file.parts:  # scripts that run in an environment of their own
            continue
        names = eager_imports(file.read_text("utf-8"))
        assert not {name for name in names if name.split(".")[0] == "scipy"}, file


def packages_imported(source: str) -> set[str]:
    """Packages and single files of validation that a source text imports, wherever in it."""
    names = (name.split(".") for name in imported_names(source))
    return {parts[2] for parts in names if parts[:2] == ["palpate", "validation"] and parts[2:]}


def circles(uses: dict[str, set[str]]) -> set[str]:
    """Whoever can be reached from itself."""
    reached = {name: set(used) for name, used in uses.items()}
    for middle in uses:
        for found in reached.values():
            if middle in found:
                found |= reached[middle]
    return {name for name, found in reached.items() if name in found}


def test_a_circle_of_three_is_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == {"a", "b", "c"}
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == set()


# ------------------------------------------------------------------------ the floors of the judge
# A package of validation imports only from the lines above its own. The architecture page of the
# documentation shows the same lines.
FLOORS = (
    ("exchange",),
    ("metrics",),
    ("case", "candidates"),
    ("references", "diagnosis", "importing"),
    ("judging",),
    ("report",),
    ("live", "peers", "studies"),
    ("commands",),
    ("documentation",),
)
MOST_PACKAGES = 18


def floor_of(package: str) -> int:
    return next(k for k, names in enumerate(FLOORS) if package in names)


def test_a_package_of_the_judge_imports_only_from_the_floors_above_it() -> None:
    wrong = []
    packages = {name for names in FLOORS for name in names}
    for package in sorted(packages):
        for file in python_files(f"validation/{package}"):
            used = packages_imported(file.read_text("utf-8")) & packages - {package}
            wrong += [(file.name, u) for u in used if floor_of(u) >= floor_of(package)]
    assert wrong == []


def test_the_judge_has_few_packages() -> None:
    folders = {file.parent for file in python_files("validation")}
    assert len(folders) <= MOST_PACKAGES, sorted(map(str, folders))
    named = {f.relative_to(ROOT / "validation").parts[0] for f in folders if f.name != "validation"}
    assert named == {name for names in FLOORS for name in names} | {"examples"}


def test_no_folder_of_the_judge_is_in_a_circle() -> None:
    files = module_files()
    folders = {name: str(f.parent.relative_to(ROOT)) for name, f in files.items()}
    uses: dict[str, set[str]] = {}
    for name, file in files.items():
        folder = folders[name]
        if not folder.startswith("validation/"):  # its own files stand below and above packages
            continue
        used = {folders[n] for n in imported_names(file.read_text("utf-8")) if n in folders}
        uses.setdefault(folder, set()).update(used - {folder})
    assert circles({a: {b for b in used if b in uses} for a, used in uses.items()}) == set()


def test_the_architecture_page_shows_the_floors_that_are_enforced() -> None:
    page = (ROOT / "validation" / "documentation" / "architecture.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d) \| (.*?) \|", page, re.M)
    shown = tuple(tuple(re.findall(r"`(\w+)`", names)) for _, names in rows)
    assert shown == FLOORS


# --------------------------------------------------------------------- circles of files, and sizes
def module_files() -> dict[str, Path]:
    """Every module of the four rooms by its name."""
    found = {}
    for room in ROOMS:
        for file in python_files(room):
            parts = file.relative_to(ROOT).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found["palpate." + ".".join(parts)] = file
    return found


def test_no_two_files_import_one_another_in_a_circle() -> None:
    files = module_files()
    uses = {
        name: {n for n in imported_names(file.read_text("utf-8")) if n in files} - {name}
        for name, file in files.items()
    }
    # `from package import module` names the package too, whose door is another matter.
    doors = {name for name, file in files.items() if file.name == "__init__.py"}
    uses = {name: used - doors for name, used in uses.items()}
    assert circles(uses) == set()


# Lines of Python at most, blank lines counted. Raising one takes a reason in its row.
LINES = {
    "meshes": (
        9790,
        "issue 37: surfaces in text at once, with per cent, beside the slow way; "
        "issue 37: equal and near points by keys; "
        "issue 38: meshes and surfaces are printed in a line; "
        "issue 37: VTU files written four times as fast; open copies of sheets; "
        "issue 37: volumes by long rows; "
        "issue 37: thin fins, least gaps, grids of VTK 5.1; "
        "issue 37: label images and the walls between labels; "
        "surfaces as other programs write them (OBJ, OFF, STL, PLY, polygons); "
        "issue 38: gravity and spread_force for a first script; "
        "issue 34: what results, models and files may not do; hashes; numpy 2's text .msh; "
        "issue 36: masses on the surface; issue 40: history of released versions",
    ),
    "fastsim": (
        14580,
        "issue 37: what pierces a wall is pushed back; the union of bodies; "
        "issue 35: cells under compression; "
        "issue 35: smoothed cells that fold under a tool are named; "
        "issue 35: classes of cells, steps of several lengths; "
        "issue 37: critical cells of large meshes in one pass, progress in per cent, plain shells; "
        "issue 35: small cells near tools, and where one touches first; "
        "issue 37: repairs by part, wraps both ways within their time; "
        "issue 35: contact over facets; issue 36: sensitivities of equilibria, small swings; "
        "issue 37: regions with common walls; issue 38: equilibria from a start",
    ),
    "reference": (
        11400,
        "issue 39: three meshes for what is judged; issue 35: cells under compression; "
        "issue 35: contact over facets, friction and starts there, few that can be nearest; "
        "issue 36: masses on the surface; "
        "issue 39: where the truth has no limit, and where it is one of several; multigrid from "
        "degree 2 to 1; issue 38: the way of a tool to a pose, "
        "truths that end where they decide on it; critical loads by few solves; "
        "issue 33: stresses by one compiled expression, no listing of forms at each",
    ),
    "validation": (
        54160,
        "issue 37: commands loaded one by one, fTetWild, the cells that decide the time step; "
        "issue 35: cells under compression; "
        "issue 38: what three new users stopped at: refusals, sizes, waits, next steps; "
        "issue 38: a report in words, per cent and one date; "
        "issue 38: bands, truth's record, figures that hide nothing, hash of all inputs; "
        "issue 38: each case of a gate has its verdict; motions by other schemes; "
        "issue 35: small cells near tools, also on the page, force that ripples, impacts; "
        "issue 37: coarser labels; "
        "issue 37: `--repair-limit`, the table of parts; "
        "issue 37: bodies of label images; issue 36: measured tracks, and fits to them; "
        "issue 39: one cause of all deformations of a law, branches and corners, calibration; "
        "issue 40: history of released versions, "
        "more simulators, FEBio, SOFA and Drake; "
        "issue 38: the report's first screen answers; ways in: shapes, pictures and loads from "
        "Python, guesses of `init` that are solved; cases that state measurements, palpate fit",
    ),
    "tests": (
        66540,
        "issue 39: truths of what is judged; "
        "issue 37: the cells that decide the time step; text at once as word by word; "
        "issue 37: walls pushed back, bodies united, keys of points, zlib's level, plain shells; "
        "issue 35: cells under compression; "
        "issue 35: cells that fold; "
        "issue 38: what three new users stopped at; "
        "issue 38: no keys, fractions or empty bars on a report; "
        "issue 38: figures, the truth's record, hash of all inputs, modes of one flat cell; "
        "issue 35: steps of several lengths, against a scheme written by itself; "
        "issue 38: a gate's cases, laws that invert, motions by other schemes, held poses; "
        "issue 37: fourteen kinds of damage on any organ; "
        "issue 37: what large meshes cost beside their mesher, per cent, bounds, thin walls; "
        "issue 35: CGS-4, two elastic bodies against Hertz, bars of ripples, eight set-ups; "
        "issue 35: an impact's momentum and energy, numbers of hertz; "
        "issue 35: CGS-4, friction over facets, two elastic bodies against Hertz, "
        "bars of ripples, eight set-ups; "
        "issue 37: what a repair does to each part; "
        "issue 37: label images; issues 34, 35: stated equations, stale results, imports, "
        "lost files, VTK files that are cut off; contact over facets, and where it begins; "
        "mutants of the judge; "
        "issue 36: masses on the surface, measurements, fits to them, swings; "
        "issue 38: first screen of a report, the live page in two browsers, units of a page; "
        "issue 39: known results of contact, motion and inflation; "
        "issue 40: stand-ins for FEBio and SOFA",
    ),
    "validation/candidates": (1550, "issue 34: what is asked for beside what a result states"),
    "validation/case": (
        4270,
        "issue 38: how far a case's meshing is; "
        "issue 38: [mesh] beside a mesh file is refused; "
        "issue 37: no slivers where labels meet; "
        "issue 35: a case on small cells near tools; issue 37: coarser labels; "
        "issue 36: [[mass]], measurements, other values of a case; issue 37: label images; "
        "issue 38: the first case marks every guess",
    ),
    "validation/commands": (
        2900,
        "issue 37: the cells that decide the time step; "
        "issue 35: cells under compression; "
        "issue 38: reports name what was not judged, and say what to do next; "
        "issue 35: `--near-tool`, `--multirate`; issue 37: `mesh --wall`, `--voxel-edge`; "
        "issue 38: each case of a gate has its verdict, cells inside out; "
        "issue 37: `mesh --label`; issue 40: history of releases; issue 38: `init --copy`; "
        "issue 36: `fit`, `solve --set`",
    ),
    "validation/diagnosis": (
        2630,
        "issue 38: laws that invert, plane stress, motions by other schemes; "
        "issue 40: Lamé's parameters by name, constants of stable laws, loads and results in other "
        "frames, plane stress and strain; issue 39: one cause of a law",
    ),
    "validation/documentation": (1000, "issue 33: formulas are set by conf.py"),
    "validation/examples": (230, "as of 24 November 2026"),
    "validation/exchange": (1520, "issue 38: since when a motion holds NaN, states to its end"),
    "validation/importing": (3080, "issue 34: what is not understood is refused, one routine"),
    "validation/judging": (
        4750,
        "issue 35: small cells near tools, by the stored truth; bars of the candidate alone; "
        "issue 38: dates of outputs, outputs of refused gates, short reprs; "
        "issue 38: scales of error budgets where the volume hardly changes; "
        "issue 35: small cells near tools, by the stored truth; "
        "issue 34: what results, models and files may not do; issue 38: no truth without a result, "
        "where a motion leaves; issue 36: verdicts on measurements; issue 39: corners and branches",
    ),
    "validation/live": (
        3480,
        "issue 38: a tool that was stopped says so until it moves, reasons in the page's units; "
        "issue 38: poses too deep and bodies too large are refused at once; "
        "issue 35: small cells where the page's tool touches first; "
        "issue 34: how the page is opened, and what recordings may not replace; "
        "issue 38: inclusions inside, poses are brought to rest, answers in words by the buttons",
    ),
    "validation/metrics": (
        5520,
        "issue 35: cells under compression; "
        "issue 38: where a law gives way; implicit steps of a diagnosis; "
        "issue 35: force that ripples while a tool slides, an impact's momentum and energy; "
        "issue 33: one way to measure; issue 36: tracks of markers on a real body, pins; "
        "issue 38: steps that do not divide the outputs, where a motion leaves",
    ),
    "validation/peers": (
        7750,
        "issue 40: released versions, three more simulators, XPBD, FEBio, SOFA and Drake; work "
        "against precision of press and strip; contact of others",
    ),
    "validation/references": (
        3710,
        "issue 35: cells under compression; "
        "issue 38: steps that do not divide the outputs, truths of what is judged alone; "
        "issue 39: corners and branches",
    ),
    "validation/report": (
        4580,
        "issue 38: tables that a program reads, an odd size is asked about; "
        "issue 38: checks, bars, inputs in words and per cent, sheets with title and number; "
        "issue 38: a band for each answer, linear strain's error, the truth's record, depth of "
        "tools, what a body hides of them, outlines, softest shapes that buckle; "
        "issue 37: pictures of bodies of several materials, cut open; "
        "issue 38: first screen, paper, units of the case, inclusions in 3-D, animations; "
        "issue 35: layers between clamps; issue 36: measured beside computed",
    ),
    "validation/studies": (
        4830,
        "issue 38: what is allowed is drawn in a sweep; "
        "issue 39: calibration of round bodies, contact and stress; "
        "issue 33: what tests prove is no study; issue 36: fits of a case to measurements; "
        "issue 38: a sweep's page leads with its answer",
    ),
}


@pytest.mark.parametrize("folder", LINES)
def test_a_room_keeps_to_its_lines(folder: str) -> None:
    most, reason = LINES[folder]
    lines = sum(len(f.read_text("utf-8").splitlines()) for f in python_files(folder))
    assert reason
    assert lines <= most


def test_every_package_has_its_lines() -> None:
    packages = {f"validation/{name}" for names in FLOORS for name in names}
    assert packages | {*ROOMS, "tests"} <= set(LINES)


# ----------------------------------------------------------------------- how many files a law takes
# Of E and nu, written in invariants: what says its formulas, in words or in code.
FILES_OF_A_LAW = {
    "meshes/material_law.py",
    "reference/laws.py",
    "fastsim/core/mechanics/law.hpp",
    "validation/metrics/laws.py",
    "validation/exchange/conventions.toml",
}


def test_a_new_law_touches_five_files() -> None:
    files = [f for room in ROOMS for s in ("py", "pyi", "?pp", "inl", "toml")
             for f in (ROOT / room).rglob(f"*.{s}")]  # fmt: skip
    named = re.compile(r"neo.hookean.stable.log", re.I)
    found = {str(f.relative_to(ROOT)) for f in files if named.search(f.read_text("utf-8"))}
    # Other simulators have it, too.
    assert {f for f in found if not f.startswith("validation/peers/")} == FILES_OF_A_LAW


# ------------------------------------------------------------------- how much the judge draws along
MOST_LOADED = 110


def test_the_judge_loads_few_modules() -> None:
    code = (
        "import sys, palpate.validation.judging.judge\n"
        "print(sum(name.startswith('palpate.') for name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) <= MOST_LOADED


# What a command needs not is not loaded: the seconds before a mesh are the user's.
@pytest.mark.parametrize(
    ("words", "unneeded"),
    [
        (["--version"], ("meshio", "rich", "palpate.validation.case")),
        (["mesh", "kidney", "--size", "20"], ("palpate.validation.case.schema", "scipy")),
    ],
)
def test_a_command_loads_its_own_module_and_no_schema(
    words: list[str], unneeded: tuple[str, ...], tmp_path: Path
) -> None:
    output = ["-o", str(tmp_path / "kidney.vtu")] if words[0] == "mesh" else []
    code = (
        "import sys\n"
        "from palpate.validation.cli import main\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert not end.code\n"
        f"print([m for m in sys.modules if m in {unneeded}])\n"
        "print([m for m in sys.modules if m.startswith('palpate.validation.commands.')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words, *output], capture_output=True, text=True, check=True
    )
    *_, others, commands = done.stdout.splitlines()
    assert others == "[]"
    assert "commands.endings" in commands
    assert "commands.judging" not in commands


# From a displacement of the core to the verdict of one check: files of which a function runs.
MOST_FILES = 15


def test_a_displacement_passes_few_files_on_its_way_to_a_verdict() -> None:
    case = palpate.load_case("kidney")
    displacement = palpate.solve(case.problem).displacement
    references = find_references(case, live=False, progress=in_silence)
    spec = next(c for c in case.checks if (c.metric, c.against) == ("displacement_l2", "same_mesh"))
    files = set()

    def note(frame: FrameType, event: str, _arg: object) -> None:
        path = frame.f_code.co_filename
        if event == "call" and "/palpate/" in path and frame.f_code.co_name != "<module>":
            files.add(path)

    sys.setprofile(note)
    try:
        judge, mesh = CaseJudge(case, references), case.problem.mesh
        strain = judge.strain_of(spec)
        state = make_state(mesh, displacement, label="x", simulator="x", strain=strain)
        found = judge.check(spec, state)
    finally:
        sys.setprofile(None)
    assert found.verdict is Verdict.PASSED
    assert 5 < len(files) <= MOST_FILES, sorted(files)


@pytest.mark.parametrize("room", [*ROOMS, "tests"])
def test_no_file_is_too_long(room: str) -> None:
    files = [f for s in ("*.py", "*.cpp", "*.hpp") for f in (ROOT / room).rglob(s)]
    assert files
    lengths = {str(f.relative_to(ROOT)): len(f.read_text("utf-8").splitlines()) for f in files}
    assert {name: n for name, n in lengths.items() if n > MOST_LINES} == {}


def test_the_root_is_as_it_was_fixed() -> None:
    """The person the repository is built for named what stands at its root, and nothing else."""
    done = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        pytest.skip("not a git checkout")
    top = {line.split("/")[0] for line in done.stdout.splitlines()}
    fixed = {"pyproject.toml", "README.md", "Makefile", "LICENSE", "CHANGELOG.md", "CITATION.cff"}
    assert {name for name in top if not name.startswith(".")} == fixed | {*ROOMS, "tests"}
