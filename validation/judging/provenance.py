"""The record of a judged case: versions, command, machine, and the hashes of all that decides."""

from __future__ import annotations

import datetime
import platform
import shlex
import sys
from typing import Any

import numpy as np

from palpate.meshes.fingerprint import file_hash
from palpate.meshes.quality import measure_quality
from palpate.validation.cached_results import text_hash
from palpate.validation.case import Case
from palpate.validation.references.reference_set import ReferenceSet
from palpate.validation.references.stored import problem_key
from palpate.validation.states import Precision
from palpate.validation.versions import version_of

# The hash of a stored reference's contents, in its record.
STORED_HASH = "sha256"


def input_key(case: Case, references: ReferenceSet, precision: Precision | None = None) -> str:
    """SHA-256 over everything that decides a verdict, except the candidate itself.

    The problem; every key of the case file, so limits, evidence and [truth] too, though neither
    comments nor spaces; the files that it names; the precision that the caller grants; the stored
    reference. References that were solved here follow from the problem and the versions beside.
    """
    # Surfaces of the truth and measured files are in no problem's key.
    files = [file_hash(path) for path in case.files[1:] if path.is_file()]
    return text_hash(
        problem_key(case.problem),
        case.spec.model_dump_json(by_alias=True),
        *files,
        str(precision or ""),
        stored_record(references.provenance).get(STORED_HASH, ""),
    )


def time_now() -> str:
    """The time in UTC, to seconds: 2026-01-31T08:15:00+00:00."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def stored_record(reference: Any) -> dict[str, Any]:
    """The record of a stored truth in that of a reference: the whole one, or its `stored`."""
    return dict(reference.get("stored") or reference)


def provenance_of(
    case: Case, references: ReferenceSet, precision: Precision | None
) -> dict[str, Any]:
    """Where and when a case was judged, with what, and against which reference."""
    mesh = case.problem.mesh
    quality = measure_quality(mesh)
    return {
        "palpate": version_of("palpate"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "time": time_now(),
        "command": shlex.join(["palpate", *sys.argv[1:]]),
        "case_key": problem_key(case.problem),
        "input_key": input_key(case, references, precision),
        "case_file": case.file,
        "called": case.called,
        "near_tool": case.near_tool is not None,
        "mesh": {
            "origin": case.mesh_origin,
            "num_points": mesh.num_points,
            "num_cells": mesh.num_cells,
            "smallest_dihedral_deg": quality.smallest_dihedral_deg,
            "longest_edge": quality.longest_edge,
        },
        "reference": {"origin": references.origin, **references.provenance},
    }
