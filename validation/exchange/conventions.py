"""What case.json says in words, as `conventions.toml` has them."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Strain


@cache
def _texts() -> dict[str, Any]:
    file = resources.files("palpate.validation.exchange") / "conventions.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def describe_conventions(strain: Strain, law: Law = Law.SAINT_VENANT_KIRCHHOFF) -> dict[str, Any]:
    """What all cases with a strain measure and law have in common: keys of case.json and texts.

    Law, arrays (of each its files, shape, unit and meaning), the equations by topic, all the
    document's keys, and what to answer.
    """
    texts = _texts()
    own = texts[strain]
    topics = texts["conventions"] | {"internal_force": own["internal_force"]}
    if strain is Strain.GREEN and not law.is_linear_in_strain:
        own = {"law": texts["laws"][law]["energy"]}
        topics["internal_force"] = texts["laws"]["internal_force"].replace(
            "{stress}", texts["laws"][law]["stress"]
        )
        del topics["smoothed_element"]
    topics["pressure"] = topics["pressure"].replace("{pressure}", texts[strain]["pressure"])
    return {
        "law": own["law"],
        "arrays": texts["arrays"],
        "conventions": topics,
        "keys": texts["keys"],
        "answer": texts["answer"],
    }
