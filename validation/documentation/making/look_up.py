"""What can be looked up: metrics, laws, seeded faults, studies, benchmarks."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import typer
from typer.cli import get_docs_for_click

from palpate.meshes.material_law import Law
from palpate.validation.candidates.faults import Fault
from palpate.validation.case.schema_keys import editor_schema
from palpate.validation.cli import app
from palpate.validation.metrics import CATALOGUE
from palpate.validation.metrics.catalogue import Metric
from palpate.validation.peers.bench import MODULES
from palpate.validation.states import ExitCode
from palpate.validation.studies import STUDIES, load_study


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    cells = ([c.replace("|", "\\|").replace("\n", " ") for c in line] for line in lines)
    return "\n".join("| " + " | ".join(line) + " |" for line in cells) + "\n"


# The command line: every command with its options, and what its exit code means.


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


# The page of a case file's keys, from the schema that `palpate schema` writes.


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
                (
                    f"`{key}`",
                    _type(one),
                    _default(key, one, required),
                    one.get("description", ""),
                )
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


def metrics() -> str:
    """Every metric by name, in groups by what it is compared with."""
    groups: dict[str, list[Metric]] = {
        "Against a reference": [m for m in CATALOGUE.values() if m.is_compared],
        "Against a published number": [m for m in CATALOGUE.values() if m.is_published],
        "Of the candidate alone": [m for m in CATALOGUE.values() if m.is_own],
    }
    parts = [
        "# Metrics\n\nWhat a `[[check]]` may ask for. An error is divided by its scale, so that "
        "0.05 is five per cent of it. Against the truth it carries the truth's error bar.\n"
    ]
    for title, group in groups.items():
        rows = [(f"`{m.name}`", m.meaning, m.scale or "-", _held(m)) for m in group]
        head = ("metric", "what it says", "divided by", "goes with")
        parts += [f"## {title}\n", table(head, rows), ""]
    return "\n".join(parts)


def _held(metric: Metric) -> str:
    """What a check of it must or may say."""
    if metric.is_own:
        words = ["`candidate`"]
    elif metric.is_published:
        words = ["`candidate`, `truth`", *(f"`{key}`" for key in metric.asks)]
    else:
        words = ["`same_mesh`" if metric.needs_same_mesh else "`same_mesh`, `truth`"]
    words += ["`region` or `support`"] if metric.of_part else []
    words += ["cases with tools"] if metric.needs_tools else []
    words += ["motions"] if metric.needs_time else []
    return ", ".join(words)


def laws() -> str:
    """Every law with its energy, source and range."""
    about = (inspect.getdoc(Law) or "").split(">>>")[0]
    parts = ["# Laws\n"]
    for block in re.split(r"\n(?=[A-Z_]+: )", about.strip()):
        name, _, text = block.partition(": ")
        if name in Law.__members__:
            words = " ".join(text.split())
            words = words[:1].upper() + words[1:]
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


def studies() -> str:
    """Every study, with what the head of its module says of it."""
    parts = [
        "# Studies\n\nA study remakes a figure or table of the paper, or shows what results depend "
        "on. It puts claims to the test, and ends with 1 when one does not hold: `palpate study "
        "NAME -o FOLDER`.\n"
    ]
    for name, line in STUDIES.items():
        parts += [f"## `{name}`\n", f"{line[0].upper()}{line[1:]}.\n"]
        about = (load_study(name).__doc__ or "").strip().split("\n\n")[1:]
        parts += [_plain(" ".join(paragraph.split())) + "\n" for paragraph in about]
    return "\n".join(parts)


def benchmarks() -> str:
    """Every benchmark, with what the head of its module says of it."""
    parts = [
        "# Benchmarks\n\n`palpate bench NAME` times palpate beside the rivals that are installed, "
        "in one run; `--json` keeps the rows. Those that are not installed are named.\n"
    ]
    for name, path in MODULES.items():
        module = importlib.import_module(path)
        paragraphs = (inspect.getdoc(module) or "").split("\n\n")
        parts += [f"## `{name}`\n", *(_plain(" ".join(p.split())) + "\n" for p in paragraphs)]
    return "\n".join(parts)


def _plain(text: str) -> str:
    """Text in which nothing is taken for a mark of Markdown."""
    return re.sub(r"([*_<|\[\]])", r"\\\1", text)
