"""Which mutants are tried: small slips in the judge's own sources, drawn by a fixed seed.

Cosmic Ray says where a source can be mutated and how. Four kinds are drawn, the same number of
each: another comparison, another constant, another sign, and a result that is not returned. The
draw is by a hash of the mutant itself, so that a change elsewhere does not draw all anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cosmic_ray.plugins
import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.ast.ast_query import ASTQuery
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator

ROOT = Path(__file__).parents[2]
PACKAGES = ("judging", "metrics", "references", "exchange", "importing", "diagnosis")
SEED = 2026
# By the first letters of the operator's name.
KINDS = {
    "comparison": ("core/ReplaceComparisonOperator_",),
    "constant": ("core/NumberReplacer", "core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue"),
    "sign": (
        "core/ReplaceUnaryOperator_", "core/ReplaceBinaryOperator_Add_Sub",
        "core/ReplaceBinaryOperator_Sub_Add",
    ),
    "return": ("ReturnNone",),
}  # fmt: skip


class ReturnNone(Operator):  # type: ignore[misc]  # Cosmic Ray is not typed
    """An operator after Cosmic Ray's own: a function returns None instead of its result."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        """Each return of something."""
        if node.type == "return_stmt" and node.children[1].get_code().strip() != "None":
            yield (node.start_pos, node.end_pos)

    def mutate(self, node: Any, index: int) -> Any:
        """The same without the result."""
        assert index == 0
        old = node.children[1]
        node.children[1] = parso.python.tree.Name("None", old.start_pos, prefix=" ")
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        """None: the draw is tested instead."""
        return ()


@dataclass(frozen=True)
class Mutant:
    """One slip.

    Attributes:
        path: Of the source, from the root.
        line: Where, from 1.
        kind: Comparison, constant, sign or return.
        operator: Cosmic Ray's name of it.
        occurrence: Which of the operator's places in the source.
        position: Where in words that survive changes elsewhere: path, function, the line's text and
            what becomes of it.
    """

    path: str
    line: int
    kind: str
    operator: str
    occurrence: int
    location: str

    def source(self) -> str:
        """The whole source with the slip."""
        code = (ROOT / self.path).read_bytes()
        changed = mutate_code(code, _operator(self.operator), self.occurrence)
        assert changed is not None
        return changed if isinstance(changed, str) else changed.decode()


def _operator(name: str) -> Any:
    return ReturnNone() if name == "ReturnNone" else cosmic_ray.plugins.get_operator(name)()


def all_mutants(packages: tuple[str, ...] = PACKAGES) -> Iterator[Mutant]:
    """Every mutant of the four kinds."""
    names = [*cosmic_ray.plugins.operator_names(), "ReturnNone"]
    for package in packages:
        for path in sorted((ROOT / "validation" / package).glob("*.py")):
            yield from _of_file(path, names)


def _of_file(path: Path, names: list[str]) -> Iterator[Mutant]:
    text = path.read_text(encoding="utf-8")
    lines, name = text.splitlines(), str(path.relative_to(ROOT))
    nodes = list(ast_nodes(get_ast(text)))
    for kind, prefixes in KINDS.items():
        for operator in (n for n in names if n.startswith(prefixes)):
            known = _operator(operator)
            locations = [
                (node, start) for node in nodes for start, _ in known.mutation_positions(node)
            ]
            for occurrence, (node, start) in enumerate(locations):
                where = ASTQuery(node).get_definition_name()
                line = lines[start[0] - 1].strip()
                # Two of one operator at one place: up and down by one.
                again = sum(other == start for _, other in locations[:occurrence])
                word = operator.removeprefix("core/") + (f" {again + 1}" if again else "")
                column = start[1] - (len(lines[start[0] - 1]) - len(lines[start[0] - 1].lstrip()))
                location = f"{name}: {where}: {line}: {column}: {word}"
                yield Mutant(name, start[0], kind, operator, occurrence, location)


def draw(number: int, mutants: Iterator[Mutant] | list[Mutant]) -> list[Mutant]:
    """So many mutants, the same of each kind, those whose hashes are smallest."""
    by_kind: dict[str, list[Mutant]] = {kind: [] for kind in KINDS}
    for mutant in mutants:
        by_kind[mutant.kind].append(mutant)
    drawn = []
    for found in by_kind.values():
        found.sort(key=lambda m: hashlib.sha256(f"{SEED}|{m.location}".encode()).hexdigest())
        drawn += found[: number // len(by_kind)]
    return sorted(drawn, key=lambda m: (m.path, m.line, m.operator, m.occurrence))
