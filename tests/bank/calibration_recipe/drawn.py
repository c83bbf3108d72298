"""Which problems there are, and which of them are set apart: `problems.toml`; and their store."""

from __future__ import annotations

import hashlib
import itertools
import json
import tarfile
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration_recipe.answers import Answer
from calibration_recipe.bars import column_problem, motion_problem
from calibration_recipe.extruded import extruded_problem
from calibration_recipe.layers import layer_problem
from calibration_recipe.pressed import pressed_problem
from calibration_recipe.round import inflation_problem, torsion_problem
from calibration_recipe.slender import find_answer, kept_answer, slender_problem
from calibration_recipe.smooth import smooth_problem
from calibration_recipe.swings import impact_problem, ring_problem
from palpate.meshes.problem import Problem, Strain
from palpate.meshes.problem_files import problem_arrays
from palpate.validation.studies.calibration import HASH, store_hash

TABLE = Path(__file__).with_name("problems.toml")
_EXACT: dict[str, Callable[..., tuple[Problem, Strain, Answer | None]]] = {
    "smooth": smooth_problem,
    "layer": layer_problem,
    "column": column_problem,
    "motion": motion_problem,
    "extruded": extruded_problem,
    "inflation": inflation_problem,
    "torsion": torsion_problem,
    "stress": smooth_problem,
    "ring": ring_problem,
    "impact": impact_problem,
    "pressed": pressed_problem,
}
# Whose coefficients are drawn too.
_SEEDED = ("smooth", "stress")


@dataclass(frozen=True)
class Drawn:
    """A problem by its name.

    Attributes:
        name: FAMILY-NUMBER, with the generation behind a dot from the second on.
        family: Its family.
        maker: Who makes it.
        given: What with.
        is_apart: Whether it is among those that no factor is chosen by.
    """

    name: str
    family: str
    maker: str
    given: Mapping[str, Any]
    is_apart: bool

    def make(self) -> tuple[Problem, Strain, Answer | None]:
        """The problem, its strain measure and what is known of it; None where nothing is."""
        if self.maker in _EXACT:
            return _EXACT[self.maker](**self.given)
        problem, strain = slender_problem(**self.given)
        return problem, strain, kept_answer(self.name, problem, strain)


def draw_problems(table: Mapping[str, Any] | None = None) -> list[Drawn]:
    """All problems, family by family."""
    table = tomllib.loads(TABLE.read_text("utf-8")) if table is None else table
    found: list[Drawn] = []
    for family in table["family"]:
        names = [f"{family['name']}-{k:02d}" for k in range(1, family["count"] + 1)]
        apart = set(sorted(names, key=_digest)[: len(names) // 2])
        given = _drawn(family["draw"], names, [])
        full = dict(zip(names, names, strict=True))
        generation = max(table["generation"], family.get("generation", 1))
        if generation > 1:
            # The open half is that of the first generation, and no fresh problem is one of it.
            full |= {name: f"{name}.{generation}" for name in apart}
            open_half = {name: given[name] for name in names if name not in apart}
            fresh = _drawn(family["draw"], [full[n] for n in names if n in apart],
                           list(open_half.values()))  # fmt: skip
            given = open_half | fresh
        for name in names:
            seed = {"seed": _digest(full[name])[0]} if family["maker"] in _SEEDED else {}
            drawn = given[full[name]] | seed
            found.append(Drawn(full[name], family["name"], family["maker"], drawn, name in apart))
    return found


def _drawn(
    lists: Mapping[str, Sequence[Any]], names: Sequence[str], taken: Sequence[Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """What each name draws, no two the same, and none that is taken."""
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        tries = (_choice(lists, f"{name}/{k}") for k in itertools.count())
        found[name] = next(one for one in tries if one not in (*taken, *found.values()))
    return found


def _choice(lists: Mapping[str, Sequence[Any]], salt: str) -> dict[str, Any]:
    """One of each list."""
    return {key: v[_digest(f"{salt}/{key}")[0] % len(v)] for key, v in lists.items()}


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


def find_missing() -> None:
    """Find and keep the answers that are missing: minutes each, the same on every machine."""
    for one in draw_problems():
        if one.maker not in _EXACT:
            problem, strain = slender_problem(**one.given)
            if kept_answer(one.name, problem, strain) is None:
                find_answer(one.name, problem, strain)


def write_store(file: Path, problems: Sequence[Drawn]) -> None:
    """Write a .tar.xz, the same bytes for the same problems."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        entries = [_write_problem(folder, drawn) for drawn in problems]
        (folder / "index.json").write_text(json.dumps(entries, indent=1), encoding="utf-8")
        (folder / HASH).write_text(store_hash(folder), encoding="utf-8")
        with tarfile.open(file, "w:xz", preset=9) as tar:
            for each in sorted(folder.iterdir()):
                tar.add(each, each.name, filter=_without_time)


def _write_problem(folder: Path, drawn: Drawn) -> dict[str, Any]:
    """NAME.npz and NAME.answer.npz in a folder; the entry of the index."""
    problem, strain, answer = drawn.make()
    np.savez(folder / f"{drawn.name}.npz", **problem_arrays(problem))
    if answer is not None:
        state, motion = answer.state, answer.state.trajectory
        arrays = {"displacement": state.displacement}
        if motion is not None:
            arrays = {"times": motion.times, "displacements": motion.displacements}
        if answer.cauchy is not None and drawn.maker == "stress":
            arrays["cauchy"] = answer.cauchy
        sizes = np.array([state.volume, state.surface_area])
        np.savez(folder / f"{drawn.name}.answer.npz", sizes=sizes, **arrays)
    return {
        "name": drawn.name,
        "family": drawn.family,
        "is_apart": drawn.is_apart,
        "given": dict(drawn.given),
        "strain": str(strain),
        "surface": "" if answer is None else answer.surface,
        "radii": [] if answer is None else list(answer.radii),
        "doubts": None if answer is None else {k: float(v) for k, v in answer.doubts.items()},
    }


def _without_time(info: tarfile.TarInfo) -> tarfile.TarInfo:
    info.mtime = info.uid = info.gid = 0
    info.uname = info.gname = ""
    return info
