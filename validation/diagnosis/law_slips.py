"""Slips in the law and the material of a static case."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.problem import Material
from palpate.validation.diagnosis.explanation import Cause, Explanation
from palpate.validation.diagnosis.factors import snapped
from palpate.validation.diagnosis.static_answer import StaticAnswer, fit
from palpate.validation.metrics.finite_laws import laws_instead_of_law
from palpate.validation.metrics.laws import (
    OTHER_STRAIN,
    Array,
    hooke,
    push_forward,
    strain_of,
)

# A constant that differs by less from what was asked is said to be right.
_SAME = 1e-5
# Constants this many times larger than what was asked belong to an answer that hardly moves, or to
# a strain that the case does not have.
_ABSURD = 1e3
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def law_explanations(answer: StaticAnswer) -> Iterator[Explanation]:
    """Each other law with the material asked for."""
    body, u = answer.body, answer.displacement
    for name, law in laws_instead_of_law(body.strain, body.law).items():
        internal = body.internal(u, law)
        tried = [answer.tried(name, Cause.LAW, internal=internal)]
        if name == OTHER_STRAIN[body.strain]:
            # Pressures go with the strain measure, or are as they were asked for.
            otherwise = body.external(u, is_other=True)
            tried.append(answer.tried(name, Cause.LAW, internal=internal, external=otherwise))
        yield min(tried, key=lambda each: each.residual)
    if body.problem.inclusions:
        one = np.ones(body.mesh.num_cells)
        lmbda, mu = (of * one for of in lame_of(body.problem.material))
        name = "inclusions left out: one material everywhere"
        internal = body.internal(u, lame=(lmbda, mu))
        yield answer.tried(name, Cause.MATERIAL, internal=internal)


def material_explanations(answer: StaticAnswer) -> Iterator[Explanation]:
    """Lamé's parameters as the answer has them, by least squares, and which slip they are."""
    body = answer.body
    H = body.gradient(answer.displacement)
    E = strain_of(H, body.strain)
    none = np.zeros(body.mesh.num_cells)
    # Poisson's ratio 0 has no lmbda to multiply: then in parts of mu.
    base = body.lmbda if body.lmbda.all() else body.mu
    if body.is_linear_in_strain:
        volume_part = body.force_of(push_forward(H, hooke(E, base, none), body.strain))
        shape_part = body.force_of(push_forward(H, hooke(E, none, body.mu), body.strain))
    else:
        # Linear in the moduli, all of them.
        volume_part = body.internal(answer.displacement, lame=(base, none))
        shape_part = body.internal(answer.displacement, lame=(none, body.mu))
    has_forces = bool(answer.external[body.free].any())
    if has_forces:
        found = fit([volume_part, shape_part], answer.external, body.free)
    else:
        # Without forces only the ratio of the two can be told.
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
    name, complexity = _material_words(asked, lmbda, mu)
    internal = a * volume_part + b * shape_part
    yield answer.tried(name, Cause.MATERIAL, complexity, internal=internal)


def lame_of(material: Material) -> tuple[float, float]:
    """Lamé's parameters lmbda and mu [Pa]."""
    E, nu = material.youngs_modulus, material.poissons_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def lame_slips(lmbda: Array, mu: Array) -> dict[str, tuple[Array, Array]]:
    """What slips make of Lamé's parameters, numbers or arrays by cell, by name."""
    E = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu)
    return {
        "Lamé's parameters exchanged": (mu, lmbda),
        "bulk modulus in the place of Lamé's lmbda": (lmbda + 2.0 * mu / 3.0, mu),
        "mu in the place of 2 mu": (lmbda, 0.5 * mu),
        "4 mu in the place of 2 mu": (lmbda, 2.0 * mu),
        "Young's modulus in the place of mu": (lmbda, E),
        "lmbda of plane stress": (2.0 * lmbda * mu / (lmbda + 2.0 * mu), mu),
        "lmbda left out": (0.0 * lmbda, mu),
        "Young's modulus and the shear modulus taken for lmbda and mu": (E, mu),
    }


def _material_words(asked: Material, lmbda: float, mu: float) -> tuple[str, int]:
    E0, nu0 = asked.youngs_modulus, asked.poissons_ratio
    l0, m0 = (np.array(of) for of in lame_of(asked))
    for name, (l1, m1) in lame_slips(l0, m0).items():
        if abs(lmbda - l1) + abs(mu - m1) <= _SAME * (abs(l0) + 2.0 * m0):
            return name, 1
    if lmbda + mu == 0.0:
        return f"lmbda {lmbda:.6g} Pa and mu {mu:.6g} Pa", 3
    E, nu = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu)
    ratio = f"Poisson's ratio {nu:.6g} in the place of {nu0:.6g}"
    if abs(E / E0 - 1.0) <= _SAME:
        return ratio, 2
    factor = snapped(E / E0)
    return f"Young's modulus {factor or E / E0:.6g} times what was asked, and {ratio}", 3


def anisotropy_explanations(answer: StaticAnswer) -> Iterator[Explanation]:
    """Nine constants of a stiffness that is symmetric to the axes, by least squares.

    Of one material everywhere, with the stress linear in the strain. Worth trying only where
    nothing simpler fits: it takes in every isotropic one.
    """
    body = answer.body
    if body.problem.inclusions or not answer.external[body.free].any():
        return
    if not body.is_linear_in_strain:
        return
    H = body.gradient(answer.displacement)
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
    found = fit(forces, answer.external, body.free)
    if found is None or np.abs(found).max() > _ABSURD * body.lmbda.max() + _ABSURD * body.mu.max():
        return
    internal = body.total([c * f for c, f in zip(found, forces, strict=True)])
    l0, m0 = float(body.lmbda[0]), float(body.mu[0])
    asked = np.array([l0 + 2.0 * m0] * 3 + [l0] * 3 + [m0] * 3)
    yield answer.tried(_constants(found, asked), Cause.LAW, 4, internal=internal)


def _constants(found: Array, asked: Array) -> str:
    names = [f"C{i + 1}{j + 1}" for i, j in _PAIRS] + ["C66", "C55", "C44"]
    changed = [
        f"{name} {c:.5g} Pa where {a:.5g} Pa was asked"
        for name, c, a in zip(names, found, asked, strict=True)
        if abs(c - a) > 1e-4 * asked[0]
    ]
    return "the law is not isotropic: " + ", ".join(changed)
