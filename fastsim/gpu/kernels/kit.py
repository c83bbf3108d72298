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
        types: Types of the kernels' arguments by their names.
        kernels: Those made so far, by name.
    """

    wp: Any
    module: Any
    real: Any
    vec3: Any
    vec6: Any
    mat33: Any
    types: dict[str, Any]
    kernels: dict[str, Any] = field(default_factory=dict)

    def func(self, function: Callable[..., Any]) -> Any:
        """A function that kernels of the module call."""
        return self.wp.func(function, module=self.module)

    def kernel(self, function: Callable[..., Any]) -> Any:
        """A kernel of the module; its arguments have the names of the arrays that it is given.

        They have the types of these names, but where the kernel states another.
        """
        code, stated = function.__code__, function.__annotations__
        names = code.co_varnames[: code.co_argcount]
        function.__annotations__ = {
            name: stated[name] if name in stated else self.types[name] for name in names
        }
        self.kernels[function.__name__] = self.wp.kernel(function, module=self.module)
        return self.kernels[function.__name__]


def types_by_name(wp: Any, real: Any) -> dict[str, Any]:
    """Types of the arguments that kernels take: arrays over bodies first, and single numbers."""
    vec3, vec6 = wp.types.vector(3, real), wp.types.vector(6, real)
    mat33, vec6i = wp.types.matrix((3, 3), real), wp.types.vector(6, int)
    rows = (
        (wp.array(dtype=int),
         "begun entries go inverted is_good kinds last_row moving open_sums "
         "outside points pressed pushed row since_good start status unknown "
         "vertices"),
        (wp.array2d(dtype=vec3),
         "ahead cell_forces corner_forces counted directions displacement external "
         "force good_displacement good_increment increment inner is_free last "
         "mobility pressure touch values"),
        (int,
         "begins first is_atomic is_green num_chunks num_kinds num_points "
         "num_terms number"),
        (wp.array2d(dtype=wp.vec3d),
         "acting chunk_forces chunk_moments forces impulses moments sums "
         "vertex_moments"),
        (wp.array2d(dtype=wp.float64), "gaps increments kinetic mass offsets stiffness"),
        (wp.array(dtype=real), "keep speed_share volumes weights"),
        (wp.array2d(dtype=real), "blends given moduli presses pressures pull"),
        (wp.array(dtype=wp.float64), "at_start damping time_step total_mass"),
        (wp.array2d(dtype=wp.vec2d), "chunk_extremes extremes loss work"),
        (wp.array(dtype=wp.vec4i), "cell_nodes corners"),
        (wp.array3d(dtype=real), "changes factors"),
        (wp.array2d(dtype=int), "histories is_known"),
        (wp.array2d(dtype=vec6), "strains stresses"),
        (wp.array(dtype=mat33), "gradients"),
        (wp.float64, "rounding"),
        (wp.array3d(dtype=vec3), "dead"),
        (wp.array(dtype=wp.vec3i), "facets"),
        (wp.array(dtype=vec6i), "cell_edges"),
        (real, "limit"),
        (wp.array(dtype=wp.vec3d), "rest"),
    )  # fmt: skip
    return {name: kind for kind, names in rows for name in names.split()}


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
        kit = Kit(wp, module, real, vec3, vec6, mat33, types_by_name(wp, real))
        import_module(f"palpate.fastsim.gpu.kernels.{topic}").make(kit)
        made["modules"][topic] = module
        made |= kit.kernels
    return SimpleNamespace(**made)
