"""Hypotheses of the law and the material of a static result: another law, moduli, anisotropy.

Each is evaluated at the result, as those of `static_hypotheses`; moduli are fitted, and the mistake
is named whose moduli they are. Two that cannot be distinguished are named together.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material
from palpate.validation.diagnosis.explanation import (
    SAME_FACTOR,
    Cause,
    Explanation,
    factor_formulas,
    snapped,
)
from palpate.validation.diagnosis.static_hypotheses import StaticResult, fit
from palpate.validation.metrics.laws import (
    OTHER_STRAIN,
    hooke,
    laws_instead_of_law,
    mistaken_constants,
    push_forward,
    strain_of,
)
from palpate.validation.metrics.smoothing import Array

# A constant that differs by less from what was asked is said to be right.
_SAME = 1e-5
# Factors that are known whatever Poisson's ratio is.
_KNOWN = (2.0, 0.5, 3.0, 1 / 3, 1.5, 2 / 3, 4.0, 0.25)
# Constants this many times larger than what was asked belong to a result that hardly moves, or to
# a strain that the case does not have.
_ABSURD = 1e3
_HALF_MU, _TWICE_MU = "mu instead of 2 mu", "4 mu instead of 2 mu"
_YOUNG = "Young's modulus instead of mu"
# Names that say the factor that their mu is of.
_FACTORS_OF_MU = {_HALF_MU, _TWICE_MU, _YOUNG}
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def law_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Each other law with the material asked for."""
    body, u = result.body, result.displacement
    for name, law in laws_instead_of_law(body.strain, body.law).items():
        internal = body.internal(u, law)
        tried = [result.tried(name, Cause.LAW, internal=internal)]
        if name == OTHER_STRAIN[body.strain]:
            # Pressures go with the strain measure, or are as they were asked for.
            otherwise = body.external(u, is_other=True)
            tried.append(result.tried(name, Cause.LAW, internal=internal, external=otherwise))
        yield min(tried, key=lambda each: each.residual)
    if body.problem.inclusions:
        one = np.ones(body.mesh.num_cells)
        lmbda, mu = (of * one for of in lame_of(body.problem.material))
        name = "inclusions left out: one material everywhere"
        internal = body.internal(u, lame=(lmbda, mu))
        yield result.tried(name, Cause.MATERIAL, internal=internal)


def material_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Lamé's parameters as the result has them, by least squares, and which mistake they are."""
    body = result.body
    H = body.gradient(result.displacement)
    E = strain_of(H, body.strain)
    none = np.zeros(body.mesh.num_cells)
    # Poisson's ratio 0 has no lmbda to multiply: then in parts of mu.
    base = body.lmbda if body.lmbda.all() else body.mu
    if body.is_linear_in_strain:
        volume_part = body.force_of(push_forward(H, hooke(E, base, none), body.strain))
        shape_part = body.force_of(push_forward(H, hooke(E, none, body.mu), body.strain))
    else:
        # Linear in the moduli, all of them.
        volume_part = body.internal(result.displacement, lame=(base, none))
        shape_part = body.internal(result.displacement, lame=(none, body.mu))
    has_forces = bool(result.external[body.free].any())
    if has_forces:
        found = fit([volume_part, shape_part], result.external, body.free)
    else:
        # Without forces only the ratio of the two is determined.
        found = fit([volume_part], -shape_part, body.free)
        found = None if found is None else np.array([found[0], 1.0])
    if found is None:
        return
    a, b = (float(c) for c in found)
    if abs(a - b) <= _SAME * abs(b) and base is body.lmbda:
        # One factor for both is the stiffness, which is tried beside the loads.
        return
    lmbda, mu = a * float(base[0]), b * float(body.mu[0])
    asked = body.problem.material
    if not has_forces:
        # As stiff as was asked, for lack of what would say otherwise.
        stiffness = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu)
        lmbda, mu = (asked.youngs_modulus / stiffness * of for of in (lmbda, mu))
    name, complexity = _material_words(asked, lmbda, mu, has_forces=has_forces)
    internal = a * volume_part + b * shape_part
    yield result.tried(name, Cause.MATERIAL, complexity, internal=internal)


def lame_of(material: Material) -> tuple[float, float]:
    """Lamé's parameters lmbda and mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def lame_hypotheses(lmbda: Array, mu: Array, law: Law) -> dict[str, tuple[Array, Array]]:
    """Lamé's parameters, numbers or arrays by cell, as mistakes would have them, by name.

    Those of the constants of a stable neo-Hookean law under that law alone: at nu = 0.3 lmbda - mu
    is a third of lmbda.
    """
    E, nu = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu)

    def same_modulus(ratio: Array) -> tuple[Array, Array]:
        return E * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio)), E / (2.0 * (1.0 + ratio))

    with np.errstate(
        divide="ignore"
    ):  # plane strain's has no lmbda at nu = 1/3, nor other's at 1/2
        return {
            **mistaken_constants(law, lmbda, mu),
            "Lamé's parameters exchanged": (mu, lmbda),
            "bulk modulus instead of Lamé's lmbda": (lmbda + 2.0 * mu / 3.0, mu),
            "Lamé's lmbda instead of the bulk modulus": (lmbda - 2.0 * mu / 3.0, mu),
            _HALF_MU: (lmbda, 0.5 * mu),
            _TWICE_MU: (lmbda, 2.0 * mu),
            _YOUNG: (lmbda, E),
            "lmbda of plane stress": (2.0 * lmbda * mu / (lmbda + 2.0 * mu), mu),
            "constants of plane strain, E / (1 - nu^2) and nu / (1 - nu)": (
                2.0 * nu * mu / (1.0 - 3.0 * nu),
                mu,
            ),
            "Poisson's ratio nu / (1 - nu), of plane strain": same_modulus(nu / (1.0 - nu)),
            "Poisson's ratio nu / (1 + nu), of plane stress": same_modulus(nu / (1.0 + nu)),
            "lmbda left out": (0.0 * lmbda, mu),
            "Young's modulus and the shear modulus taken for lmbda and mu": (E, mu),
        }


def _material_words(
    asked: Material, lmbda: float, mu: float, *, has_forces: bool
) -> tuple[str, int]:
    """Every mistake that makes these parameters [Pa], or these numbers; and its complexity.

    Without forces the ratio of the two alone is known: several mistakes make the same one.
    """
    E0, nu0 = asked.youngs_modulus, asked.poissons_ratio
    l0, m0 = (np.array(of) for of in lame_of(asked))
    size, names = abs(l0) + 2.0 * m0, []
    for name, (l1, m1) in lame_hypotheses(l0, m0, asked.law).items():
        if has_forces:
            is_it = abs(lmbda - l1) + abs(mu - m1) <= _SAME * size
        else:
            is_it = abs(lmbda * m1 - l1 * mu) <= _SAME * size * abs(mu)
        names += [name] * bool(is_it)
    of_lmbda, of_mu = (float(a / b) if b else 0.0 for a, b in ((lmbda, l0), (mu, m0)))
    if not has_forces:
        words = [lame_factor_words("lmbda", of_lmbda / of_mu if of_mu else 0.0, nu0)]
    else:
        one_alone = (("lmbda", of_lmbda, of_mu), ("mu", of_mu, of_lmbda))
        words = [
            lame_factor_words(p, of, nu0) for p, of, o in one_alone if abs(o - 1.0) <= SAME_FACTOR
        ]
    is_said = has_forces and not _FACTORS_OF_MU.isdisjoint(names)
    plain = [w for w in words if w and not is_said]
    if has_forces and names:
        return ", or ".join([*names, *plain]), 1
    if has_forces and plain:
        return ", or ".join(plain), 2
    if lmbda + mu == 0.0:
        return f"lmbda {lmbda:.6g} Pa and mu {mu:.6g} Pa", 3
    E, nu = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu)
    ratio = f"Poisson's ratio {nu:.6g} instead of {nu0:.6g}"
    if not has_forces:
        several = [*plain, ratio, *names]
        same = ": without forces they are the same" if len(several) > 1 else ""
        return ", or ".join(several) + same, 2
    if abs(E / E0 - 1.0) <= _SAME:
        return ratio, 2
    factor = snapped(E / E0)
    return f"Young's modulus {factor or E / E0:.6g} times what was asked, and {ratio}", 3


def lame_factor_words(parameter: str, factor: float, nu: float) -> str:
    """What is said where one of Lamé's parameters is a known factor of what was asked, or "".

    Args:
        parameter: "lmbda" or "mu".
        factor: How many times what was asked it is [-].
        nu: Poisson's ratio that was asked for [-].
    """
    if abs(factor - 1.0) <= SAME_FACTOR:
        return ""
    formulas = factor_formulas(factor, nu)
    is_plain = any(abs(factor / known - 1.0) <= SAME_FACTOR for known in _KNOWN)
    if not (formulas or is_plain):
        return ""
    return f"Lamé's {parameter} {factor:.3f} times what was asked{formulas}"


def anisotropy_hypotheses(result: StaticResult) -> Iterator[Explanation]:
    """Nine constants of a stiffness that is symmetric to the axes, by least squares.

    Of one material everywhere, with the stress linear in the strain. Worth trying only where
    nothing simpler fits: it takes in every isotropic one.
    """
    body = result.body
    if body.problem.inclusions or not result.external[body.free].any():
        return
    if not body.is_linear_in_strain:
        return
    H = body.gradient(result.displacement)
    E = strain_of(H, body.strain)
    columns = []
    for i, j in _PAIRS:
        S = np.zeros_like(E)
        S[:, i, i] += E[:, j, j]
        if i != j:
            S[:, j, j] += E[:, i, i]
        columns.append(S)
    for i, j in _PAIRS[3:]:
        S = np.zeros_like(E)
        S[:, i, j] = S[:, j, i] = 2.0 * E[:, i, j]
        columns.append(S)
    forces = [body.force_of(push_forward(H, S, body.strain)) for S in columns]
    found = fit(forces, result.external, body.free)
    if found is None or np.abs(found).max() > _ABSURD * body.lmbda.max() + _ABSURD * body.mu.max():
        return
    internal = body.total([c * f for c, f in zip(found, forces, strict=True)])
    l0, m0 = float(body.lmbda[0]), float(body.mu[0])
    asked = np.array([l0 + 2.0 * m0] * 3 + [l0] * 3 + [m0] * 3)
    yield result.tried(_constants(found, asked), Cause.LAW, 4, internal=internal)


def _constants(found: Array, asked: Array) -> str:
    names = [f"C{i + 1}{j + 1}" for i, j in _PAIRS] + ["C66", "C55", "C44"]
    changed = [
        f"{name} {c:.5g} Pa where {a:.5g} Pa was asked"
        for name, c, a in zip(names, found, asked, strict=True)
        if abs(c - a) > 1e-4 * asked[0]
    ]
    return "the law is not isotropic: " + ", ".join(changed)
