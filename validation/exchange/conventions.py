"""What case.json says in words, as `conventions.toml` has them."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any

from palpate.meshes.problem import Strain


@cache
def _texts() -> dict[str, Any]:
    file = resources.files("palpate.validation.exchange") / "conventions.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def describe_conventions(strain: Strain) -> dict[str, Any]:
    """What all cases with a strain measure have in common: keys of case.json with their texts.

    Law, arrays (of each its files, shape, unit and meaning), the equations by topic, all the
    document's keys, and what to answer.
    """
    texts = _texts()
    own = texts[strain]
    topics = texts["conventions"] | {"internal_force": own["internal_force"]}
    topics["pressure"] = topics["pressure"].replace("{pressure}", own["pressure"])
    return {
        "law": own["law"],
        "arrays": texts["arrays"],
        "conventions": topics,
        "keys": texts["keys"],
        "answer": texts["answer"],
    }
