"""The types and the module of Warp that the kernels of one topic and precision have in common."""

from collections.abc import Callable
from dataclasses import dataclass, field
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
        kernels: Those made so far, by name.
    """

    wp: Any
    module: Any
    real: Any
    vec3: Any
    vec6: Any
    mat33: Any
    kernels: dict[str, Any] = field(default_factory=dict)

    def func(self, function: Callable[..., Any]) -> Any:
        """A function that kernels of the module call."""
        return self.wp.func(function, module=self.module)

    def kernel(self, function: Callable[..., Any]) -> Any:
        """A kernel of the module; its arguments have the names of the arrays that it is given."""
        self.kernels[function.__name__] = self.wp.kernel(function, module=self.module)
        return self.kernels[function.__name__]


def make_kernels(wp: Any, precision: str) -> SimpleNamespace:
    """All kernels of "float32" or "float64", by name; `modules` by topic.

    Each module is compiled when it is first needed.
    """
    real = getattr(wp, precision)
    vec3, vec6 = wp.types.vector(3, real), wp.types.vector(6, real)
    mat33 = wp.types.matrix((3, 3), real)
    made: dict[str, Any] = {"modules": {}}
    for topic in TOPICS:
        module = wp.get_module(f"palpate_{topic}_{precision}")
        module.options["enable_backward"] = False  # nobody differentiates through a step
        kit = Kit(wp, module, real, vec3, vec6, mat33)
        import_module(f"palpate.fastsim.gpu.kernels.{topic}").make(kit)
        made["modules"][topic] = module
        made |= kit.kernels
    return SimpleNamespace(**made)
