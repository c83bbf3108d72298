"""Slips in the law and the material of a static case."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.diagnosis.body import Body
from palpate.validation.diagnosis.explanation import OF_FORCE, Cause, Explanation
from palpate.validation.diagnosis.factors import snapped
from palpate.validation.diagnosis.fitted import fit
from palpate.validation.diagnosis.laws import (
    OTHER_STRAIN,
    Array,
    hooke,
    laws_instead_of,
    push_forward,
    strain_of,
)

# A constant that differs by less from what was asked is said to be right.
_SAME = 1e-5
# Constants this many times larger than what was asked belong to an answer that hardly moves, or to
# a strain that the case does not have.
_ABSURD = 1e3
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def law_explanations(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """Each other law with the material asked for."""
    external = body.total(body.loads(displacement))
    otherwise = body.total(body.loads(displacement, is_other=True))
    for name, law in laws_instead_of(body.strain).items():
        internal = body.internal(displacement, law)
        left = body.residual(displacement, internal, external)
        if name == OTHER_STRAIN[body.strain]:
            # Pressures go with the strain measure, or are as they were asked for.
            left = min(left, body.residual(displacement, internal, otherwise))
        yield Explanation(name, Cause.LAW, left, stated, OF_FORCE, 1)
    if body.problem.inclusions:
        mine, one = body.problem.material, np.ones(body.mesh.num_cells)
        lame = _lame(mine.youngs_modulus, mine.poissons_ratio)
        internal = body.internal(displacement, lame=(lame[0] * one, lame[1] * one))
        left = body.residual(displacement, internal, external)
        name = "inclusions left out: one material everywhere"
        yield Explanation(name, Cause.MATERIAL, left, stated, OF_FORCE, 1)


def material_explanations(body: Body, displacement: Points, stated: float) -> Iterator[Explanation]:
    """Lamé's parameters as the answer has them, by least squares, and which slip they are."""
    E = strain_of(body.gradient(displacement), body.strain)
    H = body.gradient(displacement)
    none = np.zeros(body.mesh.num_cells)
    # Poisson's ratio 0 has no lmbda to multiply: then in parts of mu.
    base = body.lmbda if body.lmbda.all() else body.mu
    volume_part = body.force_of(push_forward(H, hooke(E, base, none), body.strain))
    shape_part = body.force_of(push_forward(H, hooke(E, none, body.mu), body.strain))
    external = body.total(body.loads(displacement))
    has_forces = bool(external[body.free].any())
    if has_forces:
        found = fit([volume_part, shape_part], external, body.free)
    else:
        # Without forces only the ratio of the two can be told.
        found = fit([volume_part], -shape_part, body.free)
        found = None if found is None else np.array([found[0], 1.0])
    if found is None:
        return
    a, b = (float(c) for c in found)
    left = body.residual(displacement, a * volume_part + b * shape_part, external)
    if abs(a - b) <= _SAME * abs(b) and base is body.lmbda:
        # One factor for both is the stiffness, which is tried beside the loads.
        return
    lmbda, mu = a * float(base[0]), b * float(body.mu[0])
    if not has_forces:
        # As stiff as was asked, for lack of what would say otherwise.
        stiffness = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu)
        share = body.problem.material.youngs_modulus / stiffness
        lmbda, mu = share * lmbda, share * mu
    name, complexity = _material_words(body, lmbda, mu)
    yield Explanation(name, Cause.MATERIAL, left, stated, OF_FORCE, complexity)


def _lame(E: float, nu: float) -> tuple[float, float]:
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def _material_words(body: Body, lmbda: float, mu: float) -> tuple[str, int]:
    asked = body.problem.material
    E0, nu0 = asked.youngs_modulus, asked.poissons_ratio
    l0, m0 = _lame(E0, nu0)
    known = {
        "Lamé's parameters exchanged": (m0, l0),
        "bulk modulus in the place of Lamé's lmbda": (l0 + 2.0 * m0 / 3.0, m0),
        "mu in the place of 2 mu": (l0, 0.5 * m0),
        "4 mu in the place of 2 mu": (l0, 2.0 * m0),
        "Young's modulus in the place of mu": (l0, E0),
        "lmbda of plane stress": (2.0 * l0 * m0 / (l0 + 2.0 * m0), m0),
        "lmbda left out": (0.0, m0),
        "Young's modulus and the shear modulus taken for lmbda and mu": (E0, m0),
    }
    scale = abs(l0) + 2.0 * m0
    for name, (l1, m1) in known.items():
        if abs(lmbda - l1) + abs(mu - m1) <= _SAME * scale:
            return name, 1
    if lmbda + mu == 0.0:
        return f"lmbda {lmbda:.6g} Pa and mu {mu:.6g} Pa", 3
    E, nu = mu * (3.0 * lmbda + 2.0 * mu) / (lmbda + mu), 0.5 * lmbda / (lmbda + mu)
    ratio = f"Poisson's ratio {nu:.6g} in the place of {nu0:.6g}"
    if abs(E / E0 - 1.0) <= _SAME:
        return ratio, 2
    factor = snapped(E / E0)
    return f"Young's modulus {factor or E / E0:.6g} times what was asked, and {ratio}", 3


def anisotropy_explanations(
    body: Body, displacement: Points, stated: float
) -> Iterator[Explanation]:
    """Nine constants of a stiffness that is symmetric to the axes, by least squares.

    Of one material everywhere. Worth trying only where nothing simpler fits: it takes in every
    isotropic one.
    """
    external = body.total(body.loads(displacement))
    if body.problem.inclusions or not external[body.free].any():
        return
    H = body.gradient(displacement)
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
    found = fit(forces, external, body.free)
    if found is None or np.abs(found).max() > _ABSURD * body.lmbda.max() + _ABSURD * body.mu.max():
        return
    internal = body.total([c * f for c, f in zip(found, forces, strict=True)])
    left = body.residual(displacement, internal, external)
    l0, m0 = float(body.lmbda[0]), float(body.mu[0])
    asked = np.array([l0 + 2.0 * m0] * 3 + [l0] * 3 + [m0] * 3)
    yield Explanation(_constants(found, asked), Cause.LAW, left, stated, OF_FORCE, 4)


def _constants(found: Array, asked: Array) -> str:
    names = [f"C{i + 1}{j + 1}" for i, j in _PAIRS] + ["C66", "C55", "C44"]
    changed = [
        f"{name} {c:.5g} Pa where {a:.5g} Pa was asked"
        for name, c, a in zip(names, found, asked, strict=True)
        if abs(c - a) > 1e-4 * asked[0]
    ]
    return "the law is not isotropic: " + ", ".join(changed)
