"""Writes the pages that are made from the code: cases, keys, metrics, commands, exit codes.

    python validation/documentation/made_pages.py FOLDER

FOLDER is a copy of this one, from which Sphinx builds (.ci/docs.sh).
"""

from __future__ import annotations

import inspect
import re
import shutil
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import matplotlib as mpl
import typer
from typer.cli import get_docs_for_click

from palpate.meshes.material_law import Law
from palpate.validation.case import builtin_cases, load_case
from palpate.validation.case.editor_schema import editor_schema
from palpate.validation.case.schema import CheckSpec
from palpate.validation.cli import app
from palpate.validation.metrics import CATALOGUE
from palpate.validation.preview.picture import draw_case
from palpate.validation.simulators.faults import Fault
from palpate.validation.states import ExitCode

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "validation" / "examples"


def main() -> None:
    """Write all of them into the folder of the command line."""
    mpl.use("Agg")
    made = Path(sys.argv[1]) / "made"
    (made / "cases").mkdir(parents=True, exist_ok=True)
    write_cases(made)
    for name, text in {
        "keys": keys(),
        "metrics": metrics(),
        "laws": laws(),
        "faults": faults(),
        "exit_codes": exit_codes(),
        "commands": commands(),
        "third_party": third_party(),
    }.items():
        (made / f"{name}.md").write_text(text, encoding="utf-8")
    demos = sorted(EXAMPLES.glob("*.py"))
    for demo in demos:
        shutil.copy(demo, made / demo.name)
    (made / "demos.md").write_text(worked_examples(demos), encoding="utf-8")
    shutil.copy(ROOT / "CHANGELOG.md", made / "changelog.md")
    shutil.copy(ROOT / "validation" / "report" / "kidney.png", made / "kidney.png")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(_cell(c) for c in line) + " |" for line in lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def worked_examples(demos: Iterable[Path]) -> str:
    """The list of the examples, which are executed."""
    names = "\n".join(demo.stem for demo in demos)
    return f"# Worked examples\n\nExecuted when this was made.\n\n```{{toctree}}\n{names}\n```\n"


# ------------------------------------------------------------------ cases
def write_cases(made: Path) -> None:
    """One page for each built-in case, and their list."""
    expected = tomllib.loads(
        (resources.files("palpate.validation") / "references" / "expected.toml").read_text("utf-8")
    )
    rows = []
    for name in builtin_cases():
        case = load_case(name)
        draw_case(case, made / "cases" / f"{name}.png", by=("matplotlib",))
        (made / "cases" / f"{name}.md").write_text(_case(name, expected.get(name, {})), "utf-8")
        verdicts = [str(says["verdict"]) for says in expected.get(name, {}).values()]
        rows.append((f"[{name}](cases/{name}.md)", case.title, *[*verdicts, "-", "-"][:2]))
    names = "\n".join(f"cases/{name}" for name in builtin_cases())
    text = (
        "# Built-in cases\n\nEach with its source, what its user needs, and the verdict of "
        "fastsim on linear and on smoothed tetrahedra, as `palpate gate --all --element both "
        "--expected` holds it.\n\n"
        + table(("case", "what", "linear", "smoothed"), rows)
        + f"\n```{{toctree}}\n:hidden:\n{names}\n```\n"
    )
    (made / "cases.md").write_text(text, encoding="utf-8")


def _case(name: str, expected: Mapping[str, Any]) -> str:
    case = load_case(name)
    problem = case.problem
    comment = "\n".join(_heading_comment(case.text))
    checks = [(f"`{c.metric}`", _against(c), f"`{c.limit:g}`", c.reason) for c in case.spec.check]
    parts = [
        f"# {name}: {case.title}\n",
        f"{case.spec.description}\n" if case.spec.description else "",
        f"![{case.title}, held and loaded]({name}.png)\n",
        f"{comment}\n",
        f"{problem.mesh.num_points} points, {problem.mesh.num_cells} cells, law "
        f"{problem.material.law}, {case.spec.strain} strain.\n",
        "## What is checked\n",
        table(("metric", "against", "limit", "reason"), checks),
        "\n## What fastsim is expected to reach\n",
        table(("candidate", "verdict", "what is not passed"), _expected(expected)),
        f"\n## The file\n\n```toml\n{case.text.strip()}\n```\n",
    ]
    return "\n".join(part for part in parts if part)


def _heading_comment(text: str) -> list[str]:
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if not line.startswith("#:"):
            lines.append(line.lstrip("# "))
    return lines


def _against(check: CheckSpec) -> str:
    return str(check.against).replace("_", " ")


def _expected(expected: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    return [
        (
            candidate,
            str(says["verdict"]),
            "; ".join([*says.get("failed", []), *says.get("inconclusive", [])]) or "-",
        )
        for candidate, says in expected.items()
    ]


# ------------------------------------------------------------------ keys
def keys() -> str:
    """Every key of a case file, from the schema that `palpate schema` writes."""
    schema = editor_schema()
    tables = {"": schema, **schema["$defs"]}
    parts = [
        "# Keys of a case file\n\nA case is a TOML file. Unknown keys are errors; lengths, "
        "stresses and forces are in the units of the file's own `[units]`. `palpate schema -o "
        "palpate.schema.json` writes this for editors.\n"
    ]
    for name, part in tables.items():
        title = _title(name)
        if "properties" in part:
            parts += [f"({_anchor(name)})=\n## {title}\n", f"{part.get('description', '')}\n"]
            required = set(part.get("required", ()))
            rows = [
                (f"`{key}`", _type(one), _default(key, one, required), one.get("description", ""))
                for key, one in part["properties"].items()
            ]
            parts.append(table(("key", "value", "default", "meaning"), rows))
        elif "enum" in part:
            values = ", ".join(f'`"{value}"`' for value in part["enum"])
            meaning = part.get("description", "").strip().splitlines()
            parts += [f"({_anchor(name)})=\n## {title}\n", f"{meaning[0] if meaning else ''}\n"]
            parts.append(f"One of {values}.\n")
    return "\n".join(parts)


def _title(name: str) -> str:
    """Of a table, for people: "SupportSpec" is "support"."""
    words = re.sub(r"(Spec|At)$", "", name)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words).lower() or "The file"


def _anchor(name: str) -> str:
    return f"key-{name.lower() or 'file'}"


def _type(part: Mapping[str, Any]) -> str:
    if "$ref" in part:
        name = str(part["$ref"]).rsplit("/", 1)[-1]
        return f"[{_title(name)}](#{_anchor(name)})"
    for several in ("anyOf", "oneOf"):
        if several in part:
            return " or ".join(dict.fromkeys(_type(one) for one in part[several]))
    if "enum" in part:
        return ", ".join(f'`"{value}"`' for value in part["enum"])
    if "const" in part:
        return f"`{part['const']}`"
    kind = part.get("type", "")
    if kind == "array":
        items = part.get("items", {})
        if isinstance(items, list):
            return f"{len(items)} of {_type(items[0])}"
        return f"list of {_type(items)}"
    limits = {"exclusiveMinimum": "> ", "minimum": ">= ", "gt": "> ", "maximum": "<= "}
    found = [f"{word}{part[key]:g}" for key, word in limits.items() if key in part]
    return " ".join([str(kind), *found]).strip() or "table"


def _default(key: str, part: Mapping[str, Any], required: set[str]) -> str:
    if key in required:
        return "required"
    value = part.get("default")
    if value is None or value in ({}, []) or isinstance(value, dict):
        return "-"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`" if value != "" else "-"


# ------------------------------------------------------------------ the rest
def metrics() -> str:
    """Every metric by name."""
    rows = []
    for metric in CATALOGUE.values():
        against = (
            "the candidate alone"
            if metric.is_own
            else "a published number"
            if metric.is_published
            else "same mesh"
            if metric.needs_same_mesh
            else "same mesh, truth"
        )
        rows.append((f"`{metric.name}`", metric.meaning, metric.scale or "-", against))
    return (
        "# Metrics\n\nWhat a `[[check]]` may ask for. An error is divided by its scale, so that "
        "0.05 is five per cent of it. Against the truth it carries the truth's error bar.\n\n"
        + table(("metric", "what it says", "divided by", "held against"), rows)
    )


def laws() -> str:
    """Every law with its energy, source and range."""
    about = (inspect.getdoc(Law) or "").split(">>>")[0]
    parts = ["# Laws\n"]
    for block in re.split(r"\n(?=[A-Z_]+: )", about.strip()):
        name, _, text = block.partition(": ")
        if name in Law.__members__:
            words = " ".join(text.split())
            parts.append(f"## `{Law[name]}`\n\n{words}\n")
        else:
            parts.append(f"{(inspect.getmodule(Law).__doc__ or '').strip()}\n\n{block}\n")
    return "\n".join(parts).replace("*", "\\*")


def faults() -> str:
    """Every seeded fault of `palpate gate --self-test`."""
    return "# Seeded faults\n\n`palpate gate --self-test` makes each of these mistakes in an " + (
        "answer, and every gate that ought to see it must turn red.\n\n"
        + table(("fault", "what it does"), [(f"`{f.value}`", f.meaning) for f in Fault])
    )


def exit_codes() -> str:
    """The exit codes, the same for every command."""
    rows = [(str(int(code)), code.meaning) for code in ExitCode]
    return (
        "# Exit codes\n\nThe same for every command. With several cases the gravest decides, in "
        "the order 4, 2, 1, 3, 0. A signal ends a command with 128 and its number.\n\n"
        + table(("code", "meaning"), rows)
    )


def commands() -> str:
    """Every command with its options, as Typer writes them."""
    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="palpate")
    text = get_docs_for_click(obj=command, ctx=context, name="palpate", title="Commands")
    # Lists of --help, marked by \b, stay lists.
    text = re.sub(r"\x08\n(.+:)\n((?:  .+\n)+)", r"\1\n\n```text\n\2```\n", text)
    return text.replace("<bool>", "").strip() + "\n"


def third_party() -> str:
    """What palpate depends on, with the licence that each states of itself."""
    rows = []
    for line in sorted(metadata.requires("palpate") or [], key=str.lower):
        name, _, marker = line.partition(";")
        distribution = re.split(r"[<>=!\[ ]", name.strip())[0]
        extra = re.search(r"extra == ['\"](.+?)['\"]", marker)
        rows.append((distribution, extra[1] if extra else "always", _licence(distribution)))
    rows += [
        ("dolfinx, ufl, basix, ffcx", "the reference", "LGPL-3.0-or-later; ufl LGPL, basix MIT"),
        ("PETSc, petsc4py", "the reference", "BSD-2-Clause"),
        ("nanobind", "to build; linked in", "BSD-3-Clause"),
        ("scikit-build-core", "to build", "Apache-2.0"),
    ]
    return (
        "# Third-party notice\n\npalpate is BSD-3-Clause. Nothing of these is copied into it; "
        "nanobind's support code is linked into the compiled core. gmsh is GPL and optional: it "
        "is the independent mesher, and nothing else needs it.\n\n"
        + table(("package", "needed for", "licence"), rows)
    )


def _licence(distribution: str) -> str:
    try:
        about = metadata.metadata(distribution).json
    except metadata.PackageNotFoundError:
        return "not installed here"
    classifiers = [c for c in about.get("classifier", ()) if c.startswith("License ::")]
    stated = [
        str(about.get("license_expression", "")),
        *(c.rsplit("::", 1)[-1].strip() for c in classifiers[-1:]),
        *str(about.get("license", "")).strip().splitlines()[:1],
    ]
    return next((text for text in stated if text), "not stated")


if __name__ == "__main__":
    main()
