"""The page of what palpate needs of others, with the licence that each states of itself."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from making.look_up import table

ROOT = Path(__file__).parents[3]
# Not known to pip everywhere: Debian and conda bring them.
_FENICSX = (
    ("dolfinx", "LGPL-3.0-or-later"),
    ("ffcx", "LGPL-3.0-or-later"),
    ("ufl", "LGPL-3.0-or-later"),
    ("basix", "MIT"),
    ("PETSc, petsc4py", "BSD-2-Clause"),
    ("mpi4py", "BSD"),
)
_GROUPS = {
    "test": "tests",
    "browser": "tests of pages in a browser",
    "mutants": "`make mutants`",
    "docs": "`make docs`",
    "lint": "`make lint`",
    "peers": "the scoreboard and benches, where installed",
}
_NOT_HERE = "not installed where this was made"


def third_party() -> str:
    """Every package that an installation brings, extras apart, and what work on palpate uses.

    Raises:
        RuntimeError: A package that everybody gets is GPL, or states no licence, or is not
            installed here, so that nobody can tell.
    """
    needed = _closure("palpate", "")
    rows = [(name, licence_of(name)) for name in needed]
    wrong = [f"{name}: {reported}" for name, reported in rows if not _is_free_for_all(reported)]
    if wrong:
        raise RuntimeError(f"an installation of palpate brings {'; '.join(wrong)}")
    extras = [
        (name, extra, licence_of(name))
        for extra in metadata.metadata("palpate").get_all("Provides-Extra") or []
        for name in _closure("palpate", extra)
        if name not in needed
    ]
    with (ROOT / "pyproject.toml").open("rb") as file:
        groups = tomllib.load(file)["dependency-groups"]
    work = sorted(
        {
            (Requirement(line).name, use, licence_of(Requirement(line).name))
            for group, use in _GROUPS.items()
            for line in groups[group]
        }
    )
    return f"""# Third-party notice

palpate is BSD-3-Clause. Made from what the packages installed here state of themselves.

## What an installation brings

{table(("package", "licence"), rows)}
nanobind (BSD-3-Clause) and robin-map (MIT), which is part of it, are linked into the compiled core;
their notices are in every wheel (`THIRD_PARTY_LICENSES.txt`). Nothing else is copied.

## Extras

Only with `pip install palpate[EXTRA]`. gmsh is GPL: the independent mesher, which runs in a process
of its own, and which neither simulating nor judging needs.

{table(("package", "extra", "licence"), extras)}
## The reference

FEniCSx is not installed with palpate; the reference uses it where it is found.

{table(("package", "licence"), _FENICSX)}
## Work on palpate, and rivals

No part of an installation. Other simulators and meshers, some of them GPL, run as programs of their
own where somebody has installed them: CalculiX, GetFEM, TetGen and CGAL besides these.

{table(("package", "used for", "licence"), work)}"""


def _closure(root: str, extra: str) -> list[str]:
    """Names of all that a package brings on this system, its own left out, sorted."""
    found: set[str] = set()
    todo = [(root, extra)]
    seen = set(todo)
    while todo:
        name, wanted = todo.pop()
        try:
            lines = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        for requirement in map(Requirement, lines):
            marker = requirement.marker
            if marker and not marker.evaluate({"extra": wanted}):
                continue
            plain = re.sub(r"[-_.]+", "-", requirement.name).lower()
            found.add(plain)
            new = {(plain, option) for option in ("", *requirement.extras)} - seen
            seen |= new
            todo += new
    return sorted(found)


def licence_of(distribution: str) -> str:
    """What its metadata state, in a few words."""
    try:
        about = metadata.metadata(distribution).json
    except metadata.PackageNotFoundError:
        return _NOT_HERE
    classifiers = [c for c in about.get("classifier", ()) if str(c).startswith("License ::")]
    stated = [
        str(about.get("license_expression", "")),
        *(c.rsplit("::", 1)[-1].strip() for c in classifiers[-1:]),
        *str(about.get("license", "")).strip().splitlines()[:1],
    ]
    return next((text for text in stated if text), "not stated")


def _is_free_for_all(licence: str) -> bool:
    is_gpl = re.search(r"(?<!L)(?<!Lesser )\b(A?GPL|(Affero )?General Public)", licence)
    return not is_gpl and licence not in (_NOT_HERE, "not stated")
