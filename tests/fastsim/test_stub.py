"""The stub of the compiled core says what the core is: names, parameters, types, values."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from palpate.fastsim import _core

STUB = Path(__file__).parents[2] / "fastsim" / "_core.pyi"
ARRAYS = {"float64": "Floats", "float32": "Singles", "int32": "Ints", "uint8": "Flags"}
Signatures = dict[str, list[str]]


def normal(signature: str) -> str:
    """A signature in one way of writing: lists, tuples and sequences of one kind are alike."""
    text = re.sub(r"numpy\.ndarray\[dtype=(\w+)[^]]*\]", lambda m: ARRAYS[m[1]], signature)
    text = text.replace("palpate.fastsim._core.", "").replace("collections.abc.", "")
    (function,) = ast.parse(text.replace("def (", "def getter(") + ": ...").body
    assert isinstance(function, ast.FunctionDef)
    arguments = ast.unparse(function.args)
    arguments = re.sub(r"\b(?:list|Sequence)\[(\w+)\]|tuple\[(\w+)(?:, \2)*\]", r"\1\2s", arguments)
    assert function.returns is not None
    return f"({arguments}) -> {ast.unparse(function.returns)}"


def of_stub() -> Signatures:
    found: Signatures = {}

    def read(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef):
                found[prefix + node.name] = []
                read(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.FunctionDef):
                found.setdefault(prefix + node.name, [])
                kind = "property " if "property" in map(ast.unparse, node.decorator_list) else ""
                text = f"def f({ast.unparse(node.args)}) -> {ast.unparse(node.returns or node)}"
                found[prefix + node.name].append(kind + normal(text))
            elif isinstance(node, ast.AnnAssign) and prefix:
                kind = ast.unparse(node.annotation)
                getter = normal(f"def f(self) -> {kind}")
                found[prefix + ast.unparse(node.target)] = [f"property {getter}"]
            elif isinstance(node, ast.Assign) and prefix:
                found[prefix + ast.unparse(node.targets[0])] = [ast.unparse(node.value)]

    read(ast.parse(STUB.read_text("utf-8")).body, "")
    return found


def of_core() -> Signatures:
    found: Signatures = {}
    for name, thing in vars(_core).items():
        if name.startswith("__"):
            continue
        found[name] = [normal(s[0]) for s in getattr(thing, "__nb_signature__", ())]
        if not isinstance(thing, type):
            continue
        found[name] = []
        if members := getattr(thing, "__members__", None):
            found |= {f"{name}.{word}": [repr(value.value)] for word, value in members.items()}
            continue
        for word, member in vars(thing).items():
            given = getattr(getattr(member, "fget", member), "__nb_signature__", None)
            if given is not None:
                kind = "property " if isinstance(member, property) else ""
                found[f"{name}.{word}"] = [kind + normal(s[0]) for s in given]
    return found


def test_the_stub_has_every_name_of_the_core_and_no_other() -> None:
    assert set(of_stub()) == set(of_core())


@pytest.mark.parametrize("name", sorted(of_stub()))
def test_parameters_and_types_are_those_of_the_core(name: str) -> None:
    assert of_stub()[name] == of_core().get(name)


def test_a_stub_that_says_something_else_is_seen() -> None:
    array = "numpy.ndarray[dtype=float64, shape=(*, 3), order='C', device='cpu', writable=False]"
    core = normal(f"def at(self, places: {array}, most: int) -> numpy.ndarray[dtype=int32]")
    assert core == normal("def at(self, places: Floats, most: int) -> Ints")
    for other in (
        "def at(self, places: Ints, most: int) -> Ints",
        "def at(self, points: Floats, most: int) -> Ints",
        "def at(self, places: Floats, *, most: int) -> Ints",
        "def at(self, places: Floats, most: int) -> tuple[Ints, Ints]",
    ):
        assert core != normal(other)
