"""What a user calls says what it takes, gives and refuses, and nothing that is not there."""

from __future__ import annotations

import ast
import dataclasses
import enum
import importlib
import inspect
import re
import textwrap
from pathlib import Path

import pytest

import palpate

ROOT = Path(__file__).parent.parent
ROOMS = ("meshes", "fastsim", "reference", "validation")
# Beside the front door: what the rooms offer to who writes a viewer, a simulator or a study.
OFFERED = {
    "fastsim.body": ["Body"],
    "fastsim.contact.body_contact": ["Overlaps", "VertexCellDetector"],
    "fastsim.condensed": [
        *("CondensedModel", "CondensedResult", "CondensedSize", "CondensedSteps", "StepState"),
        *("CondensedBody", "condense", "condense_once", "condensed_size", "load_condensed"),
        "solve_condensed",
    ],
    "fastsim.contact.contact_law": ["ContactLaw"],
    "fastsim.contact.static_contact": ["ContactResult", "solve_contact"],
    "fastsim.dynamic_relaxation": ["RelaxationResult", "relax"],
    "fastsim.dynamics": ["DynamicResult", "simulate"],
    "fastsim.explicit_body": ["ExplicitBody"],
    "fastsim.grading.graded_mesh": ["GradedMesh"],
    "fastsim.mesher": ["MeshingReport", "mesh_surface", "delaunay"],
    "fastsim.statics": ["StaticResult", "solve_static"],
    "fastsim.surface_remesher": ["remesh_surface"],
    "meshes.files": ["read_mesh", "read_surface", "write_mesh", "write_surface"],
    "meshes.refinement": ["refine_problem"],
    "reference.child": ["run_task"],
    "reference.result": ["Audit", "ImplicitResult", "ReferenceResult", "SteppedResult"],
}
THINGS = {
    **{name: getattr(palpate, name) for name in palpate.api.__all__},
    **{
        f"{module}.{name}": getattr(importlib.import_module(f"palpate.{module}"), name)
        for module, names in OFFERED.items()
        for name in names
    },
}


def section(text: str, title: str) -> str | None:
    """A section of a docstring, by its title; None where there is none."""
    found = re.search(rf"^{title}:\n((?:(?: .*)?\n?)+)", inspect.cleandoc(text), re.MULTILINE)
    return found[1] if found else None


def named(lines: str | None) -> list[str]:
    """What the entries of a section are called."""
    return re.findall(r"^ {4}\*{0,2}(\w+)(?: \(.*\))?: ", lines or "", re.MULTILINE)


def parameters(node: ast.FunctionDef) -> list[str]:
    given = node.args
    every = [*given.posonlyargs, *given.args, given.vararg, *given.kwonlyargs, given.kwarg]
    return [a.arg for a in every if a is not None and a.arg not in ("self", "cls")]


def tree_of(thing: object) -> ast.FunctionDef:
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(thing))).body  # type: ignore[arg-type]
    assert isinstance(node, ast.FunctionDef)
    return node


def faults_of_function(node: ast.FunctionDef) -> list[str]:
    """What a function's docstring keeps back."""
    text = ast.get_docstring(node) or ""
    faults = [] if text else ["no docstring"]
    if re.search(r"as `\w+` does", text):
        return faults
    taken = parameters(node)
    if named(section(text, "Args")) != taken:
        faults.append(f"takes {taken}, Args names {named(section(text, 'Args'))}")
    gives = node.returns is not None and ast.unparse(node.returns) != "None"
    if gives and not (section(text, "Returns") or re.search(r"\b[Rr]eturn|^\w.* \[", text)):
        faults.append("does not say what it returns")
    raised = [n for n in ast.walk(node) if isinstance(n, ast.Raise) and n.exc is not None]
    if raised and not section(text, "Raises"):
        faults.append("does not say what it raises")
    return faults


def faults_of_class(kind: type) -> list[str]:
    """What a class's docstring, and those of its public methods, keep back."""
    text = kind.__doc__ or ""
    if dataclasses.is_dataclass(kind):
        names = [field.name for field in dataclasses.fields(kind) if not field.name.startswith("_")]
        # What is inherited may be stated by the class that it comes from.
        texts = [base.__doc__ or "" for base in kind.__mro__ if dataclasses.is_dataclass(base)]
        stated = [named(section(one, "Attributes")) or named(section(one, "Args")) for one in texts]
        inherited = [name for one in reversed(stated) for name in one]
        reported = stated[0] if stated[0] == names else inherited
        few = all(re.search(rf"\b{name}\b", text) for name in names)
        is_whole = reported == names or (not reported and few)
        faults = [] if is_whole else [f"has {names}, tells {reported}"]
    elif "__init__" in vars(kind) and not issubclass(kind, enum.Enum | Exception):
        taken = parameters(tree_of(vars(kind)["__init__"]))
        reported = named(section(text, "Args"))
        faults = [] if reported == taken else [f"takes {taken}, Args names {reported}"]
    else:
        faults = [] if text else ["no docstring"]
    for name, member in vars(kind).items():
        if not name.startswith("_") and inspect.isfunction(member):
            node = tree_of(member)
            said = ast.get_docstring(node) or ""
            if "whose arguments it takes" in said:
                continue
            unsaid = [p for p in parameters(node) if not re.search(rf"\b{p}\b", said)]
            if not said or (unsaid and len(parameters(node)) > 1):
                faults.append(f"{name}: says nothing of {unsaid}")
    return faults


@pytest.mark.parametrize("name", THINGS)
def test_what_is_offered_says_what_it_takes_gives_and_refuses(name: str) -> None:
    thing = THINGS[name]
    if inspect.isclass(thing):
        assert faults_of_class(thing) == []
    else:
        assert faults_of_function(tree_of(thing)) == []


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_names_an_argument_that_is_not_there(room: str) -> None:
    wrong = []
    for file in sorted((ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef):
                reported = named(section(ast.get_docstring(node) or "", "Args"))
                if reported and reported != parameters(node):
                    wrong.append(f"{file.relative_to(ROOT)}: {node.name}: {reported}")
    assert wrong == []


def test_a_docstring_that_keeps_something_back_is_seen() -> None:
    text = 'def f(a: int, *, b: int) -> int:\n    """Add.\n\n    Args:\n        a: One.\n    """\n'
    (node,) = ast.parse(text + "    raise ValueError(a + b)\n").body
    assert isinstance(node, ast.FunctionDef)
    assert faults_of_function(node) == [
        "takes ['a', 'b'], Args names ['a']",
        "does not say what it returns",
        "does not say what it raises",
    ]
