"""Words: factors that are known slips of units or sign, and how they and loads are said."""

from __future__ import annotations

from palpate.meshes.boundary_conditions import BodyForce, Load, PointForce, Pressure, Traction

PRESSURE_STAYS = "pressure does not follow the surface (dead load)"
PRESSURE_FOLLOWS = "pressure follows the surface, which linear theory has at rest"
_KINDS = {
    Traction: "traction",
    Pressure: "pressure",
    PointForce: "point forces",
    BodyForce: "body force",
}
UNIT_FACTORS = (1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 10.0, 100.0, 1e3, 1e4, 1e6, 1e9)
# Lengths, as a metre counts in them; an inch is 25.4 mm.
LENGTH_UNITS = {
    1e6: "micrometres",
    1e3: "millimetres",
    100.0: "centimetres",
    10.0: "decimetres",
    1e-3: "kilometres",
    1.0 / 0.0254: "inches",
}
_PLAIN = (0.0, 2.0, 0.5)
# A factor that was found is taken for a known one within this part of it.
_SNAP = 1e-5


def snapped(factor: float) -> float | None:
    """The known factor that this is, of either sign; None where it is none of them."""
    for known in (1.0, *_PLAIN[1:], *UNIT_FACTORS, *LENGTH_UNITS):
        if abs(abs(factor) - known) <= _SNAP * known:
            return known if factor > 0.0 else -known
    return 0.0 if abs(factor) <= _SNAP else None


def load_name(index: int, load: Load) -> str:
    """A load for people: its place in the case, from 1, and its kind."""
    return f"load {index + 1} ({_KINDS[type(load)]})"


def is_unit(factor: float) -> bool:
    """Whether it is one that a slip of units makes."""
    return abs(factor) in UNIT_FACTORS or abs(factor) in LENGTH_UNITS


def in_words(factor: float) -> str:
    """How many times what was asked."""
    match factor:
        case 0.0:
            return "left out"
        case -1.0:
            return "reversed"
        case 2.0:
            return "counted twice"
        case 0.5:
            return "halved"
    if is_unit(factor):
        times = abs(factor) if abs(factor) > 1.0 else 1.0 / abs(factor)
        turned = " and reversed" if factor < 0.0 else ""
        return f"{times:.4g} times too {'large' if abs(factor) > 1.0 else 'small'}{turned}"
    return f"{factor:.6g} times what was asked"


def displacement_words(factor: float) -> str:
    """A factor of the whole answer."""
    if factor == -1.0:
        return "displacement reversed in sign"
    turned = ", reversed" if factor < 0.0 else ""
    unit = LENGTH_UNITS.get(abs(factor))
    if unit is not None:
        return f"displacement in {unit}{turned}"
    return f"displacement {in_words(factor)}"


def stiffness_words(factor: float) -> str:
    """A factor of the stiffness: in statics the same as one over it of every load."""
    loads = "every load" + " " + in_words(_known(1.0 / factor)) if factor else ""
    if is_unit(factor):
        size = "small" if factor < 1.0 else "large"
        times = factor if factor > 1.0 else 1.0 / factor
        units = {
            1e-3: " (stress in kPa taken for Pa)",
            1e-6: " (stress in MPa taken for Pa)",
            1e3: " (stress in kPa where Pa was asked)",
            1e6: " (lengths in millimetres, forces in newton)",
        }.get(factor, "")
        return f"stiffness {times:.4g} times too {size}{units}, or {loads}"
    return f"stiffness {factor:.6g} times what was asked, or {loads}"


def _known(factor: float) -> float:
    known = snapped(factor)
    return factor if known is None else known
