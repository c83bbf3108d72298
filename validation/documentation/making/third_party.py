"""What palpate depends on, with the licence that each states of itself."""

from __future__ import annotations

import re
from importlib import metadata

from making.tables import table


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
