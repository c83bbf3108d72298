"""The types and the module of Warp that the kernels of one topic and precision have in common."""

from dataclasses import dataclass
from importlib import import_module
from types import SimpleNamespace
from typing import Any

# A module of Warp's for each topic, so that a run compiles only what it uses.
TOPICS = ("elasticity", "smoothing", "gathering", "loading", "touching", "stepping", "energy")
# In double precision in every mode: the energies of the monitor, and the poses of tools.
IN_DOUBLE = ("touching", "energy")


@dataclass(frozen=True)
class Kit:
    """Types of one precision, and a module.

    Attributes:
        wp: Warp.
        module: In which the kernels of a topic are compiled together.
        real: float32 or float64.
        vec3, vec6, mat33: Of such numbers.
    """

    wp: Any
    module: Any
    real: Any
    vec3: Any
    vec6: Any
    mat33: Any


def make_kit(wp: Any, topic: str, precision: str) -> Kit:
    """The kit of a topic in "float32" or "float64"."""
    real = getattr(wp, precision)
    module = wp.get_module(f"palpate_{topic}_{precision}")
    module.options["enable_backward"] = False  # nobody differentiates through a step
    return Kit(
        wp,
        module,
        real,
        wp.types.vector(3, real),
        wp.types.vector(6, real),
        wp.types.matrix((3, 3), real),
    )


def make_kernels(wp: Any, precision: str) -> SimpleNamespace:
    """All kernels of "float32" or "float64", by name; `modules` by topic.

    Each module is compiled when it is first needed.
    """
    made: dict[str, Any] = {"modules": {}}
    for topic in TOPICS:
        kit = make_kit(wp, topic, precision)
        made["modules"][topic] = kit.module
        made |= import_module(f"palpate.fastsim.gpu.kernels.{topic}").make(kit)
    return SimpleNamespace(**made)
