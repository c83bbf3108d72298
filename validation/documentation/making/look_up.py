"""What can be looked up: metrics, laws, seeded faults, studies, benchmarks."""

from __future__ import annotations

import importlib
import inspect
import re

from making.tables import table
from palpate.meshes.material_law import Law
from palpate.validation.candidates.faults import Fault
from palpate.validation.metrics import CATALOGUE
from palpate.validation.metrics.catalogue import Metric
from palpate.validation.peers.bench import MODULES
from palpate.validation.studies import STUDIES, load_study


def metrics() -> str:
    """Every metric by name, in groups by what it is held against."""
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
        "# Studies\n\nA study remakes a figure or table of the paper, or shows what answers depend "
        "on. It puts claims to the test, and ends with 1 when one does not hold: `palpate study "
        "NAME -o FOLDER`.\n"
    ]
    for name, line in STUDIES.items():
        parts += [f"## `{name}`\n", f"{line[0].upper()}{line[1:]}.\n"]
        about = (load_study(name).about or "").strip().split("\n\n")[1:]
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
