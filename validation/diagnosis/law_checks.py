"""What holds of every elastic law, and of the one that was stated, deformation by deformation.

P = dW/dF, tangent = dP/dF and its symmetry, W(Q F) = W(F) and P(Q F) = Q P(F) (objectivity),
P(F Q) = P(F) Q (isotropy), no stress at rest and Hooke's tangent there, P as the judge writes it.
R. W. Ogden, Non-linear Elastic Deformations, 1984, sections 4.2 and 6.1. Laws with one seeded error
each show that the checks see it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.boundary_conditions import PointForce, Support
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.problem import Material, Problem, Strain
from palpate.validation.candidates.candidate import outside_candidate
from palpate.validation.candidates.outside import OutsideSimulator
from palpate.validation.diagnosis.law_simulators import (
    LawOf,
    deformations,
    moderate_deformations,
    nodal_forces,
    rotations,
    separate_cells,
)
from palpate.validation.diagnosis.material_hypotheses import lame_of
from palpate.validation.metrics.laws import OgdenTerms, finite_stress, linear, stress_change
from palpate.validation.metrics.smoothing import Array
from palpate.validation.states import CandidateFailedError, Progress

# Differences of fourth order with steps of a thousandth of the smallest stretch are right to 1e-10
# or so; a derivative that is off in any user's sense is off by more than a tenth of a million.
_DERIVATIVE = 1e-7
# Limit of an identity: rounding of numbers a hundred times larger.
_IDENTITY = 1e-10
_DIRECTIONS = 3
_STEP = 1e-3


@dataclass(frozen=True)
class Finding:
    """The worst of a check over one kind of deformation, at F = `worst`, and what is wrong there.

    `error` is over the size of what was compared, `limit` the largest that passes [-]. `failed` are
    the numbers within the kind, from 1, of all that failed, `inverted` of those at which a
    simulator's cell came to rest inside out.
    """

    check: str
    kind: str
    error: float
    limit: float
    worst: Array
    message: str = ""
    failed: tuple[int, ...] = ()
    inverted: tuple[int, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether it passed; NaN has not."""
        return self.error <= self.limit


def check_law(law: LawOf, material: Material) -> list[Finding]:
    """A finding for each check and kind of deformation of a law with the material as stated."""
    found = list(_at_rest(law, material))
    kinds = deformations(material.law)
    every = np.concatenate(list(kinds.values()))
    stresses = np.concatenate([law.stress(F) for F in kinds.values()])
    cause = cause_of_stress(stresses, material, every)
    for kind, F in kinds.items():
        checks = (
            _derivative_of_energy, _derivative_of_stress, _symmetry, _objectivity, _isotropy,
        )  # fmt: skip
        for check in checks:
            found.append(check(law, material, kind, F))
        found.append(compare_stress(law.stress(F), material, kind, F, _IDENTITY, cause=cause))
    return found


def moduli_of(material: Material, count: int) -> tuple[Array, Array, Array, OgdenTerms]:
    """Lamé's parameters and c01 [Pa] of so many cells, (count,) each, and Ogden's terms."""
    lmbda, mu = (np.full(count, of) for of in lame_of(material))
    return lmbda, mu, np.full(count, material.c01), material.ogden_terms


def stated_stress(material: Material, F: Array) -> Array:
    """P of the law that was stated, by the judge [Pa], (n, 3, 3)."""
    return finite_stress(material.law, F - np.eye(3), *moduli_of(material, len(F)))


def compare_stress(
    P: Array,
    material: Material,
    kind: str,
    F: Array,
    limit: float,
    check: str = "law as stated",
    *,
    cause: str | None = None,
) -> Finding:
    """Stresses compared with those of the law that was stated.

    `cause` is what explains those of all deformations, where it is known; these alone are asked
    where it is None.
    """
    right = stated_stress(material, F)
    errors = _sizes(P - right) / _scale(right, material)
    message = ""
    if not float(errors.max()) <= limit:
        message = (cause_of_stress(P, material, F) if cause is None else cause) or _farthest(
            P, right
        )
    return _finding(check, kind, errors, limit, F, message)


def _at_rest(law: LawOf, material: Material) -> Iterator[Finding]:
    rest = np.eye(3)[None]
    lmbda, mu = lame_of(material)
    stress, energy = _sizes(law.stress(rest)) / mu, np.abs(law.energy(rest)) / mu
    wrong = "stress where nothing is deformed" if stress[0] > _IDENTITY else "energy at rest"
    yield _finding("rest", "rest", np.maximum(stress, energy), _IDENTITY, rest, wrong)
    errors = []
    for dF in _directions(rest, 9):
        e = 0.5 * (dF + dF.transpose(0, 2, 1))
        hooke = lmbda * np.trace(e, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 2.0 * mu * e
        errors.append(_sizes(law.change(rest, dF) - hooke) / _sizes(hooke))
    message = "the tangent at rest is not Hooke's with the stated E and nu"
    yield _finding("Hooke's law", "rest", np.max(errors, axis=0), _IDENTITY, rest, message)


def _derivative_of_energy(law: LawOf, material: Material, kind: str, F: Array) -> Finding:
    P, errors, ratios = law.stress(F), [], []
    for dF in _directions(F, _DIRECTIONS):
        slope = _difference(law.energy, F, dF)
        work = np.einsum("cij,cij->c", P, dF)
        errors.append(np.abs(slope - work) / _scale(P, material))
        ratios.append((slope, work))
    worst = np.unravel_index(int(np.argmax(errors)), np.shape(errors))
    along, done = (float(of[worst[1]]) for of in ratios[worst[0]])
    message = (
        f"the stress is not the derivative of the energy: along one direction dW = {along:.6g} Pa, "
        f"P : dF = {done:.6g} Pa"
    )
    return _finding("P = dW/dF", kind, np.max(errors, axis=0), _DERIVATIVE, F, message)


def _derivative_of_stress(law: LawOf, material: Material, kind: str, F: Array) -> Finding:
    errors, messages = [], []
    for dF in _directions(F, _DIRECTIONS):
        slope, change = _difference(law.stress, F, dF), law.change(F, dF)
        errors.append(_sizes(slope - change) / _scale(slope, material))
        cell = int(np.argmax(errors[-1]))
        factor = np.sum(slope[cell] * change[cell]) / np.sum(slope[cell] ** 2)
        messages.append(
            "the tangent is not the derivative of the stress: along one direction it is "
            f"{factor:.6g} times that, and off by {_sizes(change - slope)[cell]:.6g} Pa"
        )
    message = messages[int(np.argmax(np.max(errors, axis=1)))]
    return _finding("tangent = dP/dF", kind, np.max(errors, axis=0), _DERIVATIVE, F, message)


def _symmetry(law: LawOf, material: Material, kind: str, F: Array) -> Finding:
    one, other = _directions(F, 2)
    there, back = law.change(F, one), law.change(F, other)
    errors = np.abs(
        np.einsum("cij,cij->c", there, other) - np.einsum("cij,cij->c", back, one)
    ) / np.maximum(_sizes(there), material.youngs_modulus)
    message = "the tangent is not symmetric: there is no energy behind it"
    return _finding("symmetry", kind, errors, _IDENTITY, F, message)


def _objectivity(law: LawOf, material: Material, kind: str, F: Array) -> Finding:
    Q = rotations(len(F))
    P, W = law.stress(F), law.energy(F)
    scale = _scale(P, material)
    of_stress = _sizes(law.stress(Q @ F) - Q @ P) / scale
    of_energy = np.abs(law.energy(Q @ F) - W) / np.maximum(np.abs(W), scale)
    message = "a turned body has another energy" if of_energy.max() > _IDENTITY else ""
    message = message or "a turned body has another stress than the turned one"
    return _finding("objectivity", kind, np.maximum(of_stress, of_energy), _IDENTITY, F, message)


def _isotropy(law: LawOf, material: Material, kind: str, F: Array) -> Finding:
    Q = rotations(len(F))
    P = law.stress(F)
    errors = _sizes(law.stress(F @ Q) - P @ Q) / _scale(P, material)
    message = "a body turned at rest responds otherwise: the law has directions of its own"
    return _finding("isotropy", kind, errors, _IDENTITY, F, message)


def _finding(check: str, kind: str, errors: Array, limit: float, F: Array, message: str) -> Finding:
    """NaN is the worst."""
    cell = int(np.argmax(np.where(np.isnan(errors), np.inf, errors)))
    error, failed = float(errors[cell]), _numbers(~(errors <= limit))
    return Finding(check, kind, error, limit, F[cell], "" if error <= limit else message, failed)


def _numbers(chosen: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple((np.flatnonzero(chosen) + 1).tolist())


def _directions(F: Array, count: int) -> Array:
    """Random ones of size 1 for each F, (count, n, 3, 3)."""
    found: Array = np.random.default_rng(3).standard_normal((count, *F.shape))
    found /= np.linalg.norm(found, axis=(2, 3), keepdims=True)
    return found


def _difference(function: Callable[[Array], Array], F: Array, dF: Array) -> Array:
    """Derivative along dF, of fourth order, by steps that are small beside the smallest stretch."""
    h = _STEP * np.linalg.svd(F, compute_uv=False)[:, -1]
    step = h[:, None, None] * dF
    near = function(F + step) - function(F - step)
    far = function(F + 2.0 * step) - function(F - 2.0 * step)
    found: Array = (8.0 * near - far) / (12.0 * h.reshape(-1, *[1] * (near.ndim - 1)))
    return found


def _sizes(tensors: Array) -> Array:
    sizes: Array = np.linalg.norm(tensors, axis=(1, 2))
    return sizes


def _scale(P: Array, material: Material) -> Array:
    """A stress, or a hundredth of the modulus where there is hardly any."""
    scale: Array = np.maximum(_sizes(P), 0.01 * material.youngs_modulus)
    return scale


# Relative error of stress: a law that fits so well is the simulator's.
_FITS = 1e-6


# Columns of a fit that are nearer to one another than this are not distinguished: a misfit of _FITS
# would be one of a thousandth in the factors.
_APART = 1e-3


def cause_of_stress(
    P: Array, material: Material, F: Array, known: NDArray[np.bool_] | None = None
) -> str:
    """Which other law, or which moduli, all stresses P [Pa] at F are those of; "" if none is known.

    Every deformation counts alike, whatever its stress. Moduli are named only where these
    deformations tell one from the other, and where they are those of a stable material.

    Args:
        P: First Piola-Kirchhoff stresses, (n, 3, 3).
        material: What was stated.
        F: Deformation gradients [-], (n, 3, 3).
        known: Components that count, (3, 3); all where None.
    """
    H, count = F - np.eye(3), len(F)
    c01, none = np.full(count, material.c01), np.zeros(count)
    lmbda, mu, _, terms = moduli_of(material, count)
    right = finite_stress(material.law, H, lmbda, mu, c01, terms)
    weights = (1.0 if known is None else known) / _scale(right, material)[:, None, None]
    of = weights * np.where(np.ones((3, 3), dtype=bool) if known is None else known, P, 0.0)
    if not np.isfinite(of).all():
        return "the stress is no finite number" if not np.isfinite(P).all() else ""
    candidates = {
        f"the stress is that of {law}": finite_stress(law, H, lmbda, mu, c01)
        for law in Law
        # Ogden's has constants of its own.
        if law not in (material.law, Law.OGDEN)
    }
    candidates["the stress is that of linear elasticity"] = linear(H, lmbda, mu)
    transposed = finite_stress(material.law, H.transpose(0, 2, 1), lmbda, mu, c01, terms)
    candidates["the stress is that of the transposed gradient"] = transposed
    for words, found in candidates.items():
        if _misses(of, weights * found) < _FITS:
            return words
    # Linear in the moduli, all of them: parts of lmbda and of mu by least squares.
    parts = np.stack(
        [
            (weights * finite_stress(material.law, H, lmbda, none, none, terms)).ravel(),
            (weights * finite_stress(material.law, H, none, mu, c01, terms)).ravel(),
        ],
        axis=1,
    )
    lengths = np.linalg.norm(parts, axis=0)
    if not (lengths > 0.0).all():
        return ""
    sizes = np.linalg.svd(parts / lengths, compute_uv=False)
    factors = np.linalg.lstsq(parts, of.ravel(), rcond=None)[0]
    if _misses(of, (parts @ factors).reshape(of.shape)) >= _FITS:
        return ""
    factors[np.abs(factors) < _FITS] = 0.0  # a part that is left out
    if sizes[1] < _APART * sizes[0] or factors[1] <= 0.0 or factors[0] < 0.0:
        return ""
    return (
        f"the stress is that of the stated law with lmbda times {factors[0]:.6g} and mu times "
        f"{factors[1]:.6g}"
    )


def _farthest(P: Array, right: Array) -> str:
    """Where a stress is farthest from what was stated, both (n, 3, 3) [Pa]."""
    off = np.abs(P - right)
    cell, i, j = np.unravel_index(int(off.argmax()), off.shape)
    return (
        f"the stress is of no law known here: P{i + 1}{j + 1} = {P[cell, i, j]:.6g} Pa where "
        f"{right[cell, i, j]:.6g} Pa was stated"
    )


def _misses(P: Array, found: Array) -> float:
    return float(np.linalg.norm(P - found) / max(float(np.linalg.norm(P)), 1e-300))


@dataclass(frozen=True)
class Seeded:
    """A law with its energy, stress or tangent changed; `check` is the one that must see it."""

    law: LawOf
    name: str
    check: str
    of_energy: Callable[[Array, Array], Array] | None = None
    of_stress: Callable[[Array, Array], Array] | None = None
    of_tangent: Callable[[Array, Array, Array], Array] | None = None

    def energy(self, F: Array) -> Array:
        """See `LawOf`."""
        found = self.law.energy(F)
        return found if self.of_energy is None else self.of_energy(F, found)

    def stress(self, F: Array) -> Array:
        """See `LawOf`."""
        found = self.law.stress(F)
        return found if self.of_stress is None else self.of_stress(F, found)

    def change(self, F: Array, dF: Array) -> Array:
        """See `LawOf`."""
        found = self.law.change(F, dF)
        return found if self.of_tangent is None else self.of_tangent(F, dF, found)


def seeded_mistakes(law: LawOf, material: Material) -> list[Seeded]:
    """Mistakes that have been made in simulators, one at a time."""
    size = 1e-3 * material.youngs_modulus

    def trace_of_strain(F: Array) -> Array:
        traces: Array = 0.5 * (np.einsum("cij,cij->c", F, F) - 3.0)
        return traces[:, None, None]

    def stiffer(F: Array, P: Array) -> Array:
        lmbda, mu, c01, terms = moduli_of(material, len(F))
        return P + 0.01 * finite_stress(material.law, F - np.eye(3), 0.0 * lmbda, mu, c01, terms)

    return [
        Seeded(law, "energy a thousandth too large", "P = dW/dF", of_energy=lambda _, W: 1.001 * W),
        Seeded(
            law,
            "a volume term of the stress that the energy has not",
            "P = dW/dF",
            of_stress=lambda F, P: P + size * trace_of_strain(F) * F,
        ),
        Seeded(
            law,
            "the tangent's geometric part left out",
            "tangent = dP/dF",
            of_tangent=lambda F, dF, dP: dP - dF @ np.linalg.solve(F, law.stress(F)),
        ),
        Seeded(
            law,
            "a tangent without its symmetry",
            "symmetry",
            of_tangent=lambda _, dF, dP: dP + size * np.roll(dF, 1, axis=1),
        ),
        Seeded(
            law,
            "stress pushed forward by the transposed gradient",
            "objectivity",
            of_stress=lambda F, P: F.transpose(0, 2, 1) @ np.linalg.solve(F, P),
        ),
        Seeded(
            law,
            "stiffer by a tenth along x",
            "isotropy",
            of_stress=lambda _, P: P * np.array([1.1, 1.0, 1.0]),
        ),
        Seeded(law, "stress at rest", "rest", of_stress=lambda F, P: P + size * F),
        Seeded(law, "shear modulus 1 % too large", "law as stated", of_stress=stiffer),
    ]


def self_test(law: LawOf, material: Material) -> dict[str, list[Finding]]:
    """By mistake, the failed findings of the check that must see it; none where nothing does."""
    return {
        seeded.name: [
            finding
            for finding in check_law(seeded, material)
            if finding.check == seeded.check and not finding.is_good
        ]
        for seeded in seeded_mistakes(law, material)
    }


# The stress of another simulator, by bodies of single cells that it is asked to bring to rest.
#
# Each cell may do all but turn and move: its first corner is fixed, the next along y and z, the
# third along z, so that F is upper triangular. The dead forces on its free corners are those of the
# stated law at an F; the F of the simulator's result is the one at which its own law has that
# stress. A wrong law shows as another F; its error here is that of the stress at the result.

# Edge of the cells [m]: of the size of soft bodies, so that a tolerance of forces that a simulator
# has as an absolute number is within reach.
_EDGE = 0.02
# Components of F that a cell is free to take, row by row.
_FREE = np.array([[1, 1, 1], [0, 1, 1], [0, 0, 1]], dtype=bool)


# Stretches along x and y and the shear of sheets in plane stress, and Newton's rounds for their
# thickness, which converge quadratically from that of small strains.
_SHEETS = ((1.25, 1.0, 0.0), (1.15, 1.15, 0.0), (0.9, 1.1, 0.0), (1.1, 1.0, 0.3))
_ROUNDS = 12
# Less of a cell's volume is left than a solver's rounding: its law says nothing there [-].
_FLAT = 1e-9
# A cell a thousand times as long as it was: no law is meant for that, and its stress may overflow.
_BLOWN_UP = 1e3


def check_simulator(
    simulator: OutsideSimulator, material: Material, limit: float, progress: Progress
) -> list[Finding]:
    """Compare a simulator's result with that of the law that was stated, to a limit of stress [-].

    A finding for each kind of deformation; more where it sends stresses of its own, and one for
    each deformation without a result that can be compared.

    Raises:
        CandidateFailedError: It gives no result for any deformation.
    """
    wanted, of_kind, numbers, is_stable = asked_of_simulators(material)
    if not is_stable.any():
        raise InputError("no cell of this material stays where dead forces hold it")
    wanted, of_kind, numbers = wanted[is_stable], of_kind[is_stable], numbers[is_stable]
    asked = stated_stress(material, wanted)
    F, sent, why_not = _brought_to_rest(simulator, material, wanted, progress)
    good = np.array([not why for why in why_not])
    cause = ""
    if good.any():
        cause = cause_of_stress(asked[good], material, F[good], _FREE)
    found = []
    is_inverted = np.linalg.det(F) < 0.0
    for kind in dict.fromkeys(of_kind.tolist()):
        rows = good & (of_kind == kind)
        of_rows = []
        if rows.any():
            of_rows.append(_compare(asked[rows], F[rows], material, kind, limit, cause))
        if sent is not None and rows.any():
            J = np.linalg.det(F[rows])[:, None, None]
            of_rest = J * sent[rows] @ np.linalg.inv(F[rows]).transpose(0, 2, 1)
            of_rows.append(
                compare_stress(of_rest, material, kind, F[rows], limit, "stress sent", cause=None)
            )
        inverted = tuple(numbers[rows & is_inverted].tolist())
        for each in of_rows:
            failed = tuple(int(numbers[rows][k - 1]) for k in each.failed)
            found.append(replace(each, failed=failed, inverted=inverted))
        for k in np.flatnonzero(~good & (of_kind == kind)):
            which = f"{kind} {numbers[k]}"
            one = Finding("law as stated", which, np.inf, limit, wanted[k], why_not[k])
            number = (int(numbers[k]),)
            found.append(replace(one, failed=number, inverted=number if is_inverted[k] else ()))
    return found


def asked_of_simulators(
    material: Material,
) -> tuple[Array, NDArray[np.str_], NDArray[np.int32], NDArray[np.bool_]]:
    """F of the cells that a simulator may be asked for, their kinds, their numbers in these.

    The last says which a free cell of this material stays at under dead forces: the others are
    left out.
    """
    kinds = {**moderate_deformations(), "plane stress": _in_plane_stress(material)}
    F, sizes = np.concatenate(list(kinds.values())), [len(of) for of in kinds.values()]
    numbers = np.concatenate([np.arange(size, dtype=np.int32) + 1 for size in sizes])
    return F, np.repeat(list(kinds), sizes), numbers, _is_stable(F, material)


def _in_plane_stress(material: Material) -> Array:
    """Deformations of a sheet whose faces are free, (n, 3, 3): its thickness makes P33 zero."""
    F = np.array([[[a, g, 0.0], [0.0, b, 0.0], [0.0, 0.0, 1.0]] for a, b, g in _SHEETS])
    across = np.zeros_like(F)
    across[:, 2, 2] = 1.0
    nu = material.poissons_ratio
    F[:, 2, 2] = (F[:, 0, 0] * F[:, 1, 1]) ** (-nu / (1.0 - nu))  # as for small strains
    for _ in range(_ROUNDS):
        moduli = moduli_of(material, len(F))
        slope = stress_change(material.law, F - np.eye(3), across, *moduli)[:, 2, 2]
        F[:, 2, 2] -= stated_stress(material, F)[:, 2, 2] / slope
    return F


def _brought_to_rest(
    simulator: OutsideSimulator, material: Material, F: Array, progress: Progress
) -> tuple[Array, Array | None, list[str]]:
    """F of the simulator's cells, the Cauchy stresses that it sends, and why a cell has none.

    All cells are one body; each is one of its own where that has no result.
    """
    try:
        found, sent = _rest_of_cells(simulator, material, F, progress)
    except CandidateFailedError as error:
        if len(F) == 1:
            return F, None, [str(error)]
        each = [_brought_to_rest(simulator, material, one[None], progress) for one in F]
        why_not = [why for _, _, whys in each for why in whys]
        if all(why_not):
            raise
        some = next(s for _, s, (why,) in each if not why)
        zeros = np.zeros((1, 3, 3))
        sent = (
            None
            if some is None
            else np.concatenate([zeros if s is None else s for _, s, _ in each])
        )
        return np.concatenate([one for one, _, _ in each]), sent, why_not
    least = -np.inf if material.law.is_finite_when_inverted else _FLAT
    why_not = []
    for one in found:
        largest, det = float(np.abs(one).max()), float(np.linalg.det(one))
        if not largest < _BLOWN_UP:
            why_not.append(f"the cell is blown up: a component of F is {largest:.3g}")
        elif not (abs(det) > _FLAT and det > least):
            why_not.append(f"the cell is flat or inside out: det F = {det:.3g}")
        else:
            why_not.append("")
    return found, sent, why_not


def _rest_of_cells(
    simulator: OutsideSimulator, material: Material, F: Array, progress: Progress
) -> tuple[Array, Array | None]:
    """F where separate cells come to rest under the stated law's forces; stresses that are sent."""
    mesh = separate_cells(len(F), _EDGE)
    first = 4 * np.arange(len(F), dtype=np.int32)
    supports = (
        Support(first),
        Support(first + 1, components=(False, True, True)),
        Support(first + 2, components=(False, False, True)),
    )
    forces = nodal_forces(stated_stress(material, F), _EDGE)
    load = PointForce(np.arange(mesh.num_points, dtype=np.int32), forces)
    problem = Problem(mesh, material, supports, (load,))
    state = outside_candidate(simulator).solve(problem, Strain.GREEN, progress)
    # F of separate cells by where their corners went.
    moved = (state.displacement / _EDGE).reshape(-1, 4, 3)
    return np.eye(3) + (moved[:, 1:] - moved[:, :1]).transpose(0, 2, 1), state.sent_stress


def _compare(
    asked: Array, found_F: Array, material: Material, kind: str, limit: float, cause: str
) -> Finding:
    """Compare components that are free only: reactions are not known."""
    stated = np.where(_FREE, stated_stress(material, found_F), 0.0)
    known = np.where(_FREE, asked, 0.0)
    errors = _sizes(stated - known) / _scale(asked, material)
    is_good = bool((errors <= limit).all())
    message = "" if is_good else cause or _farthest(known, stated)
    return _finding("law as stated", kind, errors, limit, found_F, message)


def _is_stable(F: Array, material: Material) -> NDArray[np.bool_]:
    """Whether a free cell stays there under dead forces: the free part of dP/dF is positive."""
    components = np.argwhere(_FREE)
    tangent = np.zeros((len(F), len(components), len(components)))
    for column, (i, j) in enumerate(components):
        dF = np.zeros_like(F)
        dF[:, i, j] = 1.0
        change = stress_change(material.law, F - np.eye(3), dF, *moduli_of(material, len(F)))
        tangent[:, :, column] = change[:, components[:, 0], components[:, 1]]
    stable: NDArray[np.bool_] = np.linalg.eigvalsh(tangent)[:, 0] > 0.0
    return stable
