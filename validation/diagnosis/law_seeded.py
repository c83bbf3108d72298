"""Laws with one mistake in them, by which the checks are shown to see it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.meshes.problem import Material
from palpate.validation.diagnosis.law_checks import Finding, check_law, moduli_of
from palpate.validation.diagnosis.law_of_simulator import LawOf
from palpate.validation.metrics.finite_laws import finite_stress
from palpate.validation.metrics.laws import Array


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
