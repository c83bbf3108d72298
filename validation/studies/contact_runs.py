"""What the study of contact computes: Hertz on finer meshes, penalties of growing stiffness."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.fastsim.contact.contact_law import ContactForm, ContactLaw
from palpate.fastsim.contact.static_contact import solve_contact
from palpate.meshes.problem import Strain
from palpate.validation.studies import contact_scenes as scenes
from palpate.validation.studies.contact_bodies import Collision, Fold
from palpate.validation.studies.contact_hertz import (
    RADIUS,
    Zone,
    contact_radius,
    hertz_force,
    quarter_block,
    sphere_into_block,
)
from palpate.validation.studies.contact_speed import Speed

DEPTH = 0.01  # radii
BLOCK_SIDE = 20.0  # radii: 200 contact radii at that depth
# Edges in a contact radius, and how fast they grow with distance: all edges shrink together.
LEVELS = ((4.0, 0.4), (4.0 * 2**0.5, 0.4 / 2**0.5), (8.0, 0.2), (8.0 * 2**0.5, 0.2 / 2**0.5))
# Penalties in stiffnesses of a layer of cells, as the constraint's own is 100.
LAYERS = (3.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True)
class Level:
    """One mesh of the family: force over Hertz' at 0.01 R."""

    edges_per_radius: float
    cells: int
    linear: float
    green: float


@dataclass(frozen=True)
class Penalty:
    """Force of one penalty stiffness [Pa/m], and what it lacks of the constraint's."""

    layers: float
    stiffness: float
    lack: float
    penetration: float


@dataclass(frozen=True)
class Outcome:
    """All that was found."""

    levels: list[Level]
    pairs: list[scenes.Pair]
    last_depth: tuple[float, float, str]
    penalties: list[Penalty]
    speeds: tuple[Speed, Speed]
    collision: Collision
    fold: Fold


def hertz_level(edges_per_radius: float, growth: float, progress: Callable[[str], None]) -> Level:
    """Both strains on one mesh of the family."""
    radius = contact_radius(DEPTH * RADIUS)
    zone = Zone(radius / edges_per_radius, 1.5 * radius, growth)
    mesh = quarter_block(BLOCK_SIDE * RADIUS, zone)
    progress(f"Hertz: {edges_per_radius:.3g} edges in the contact radius, {mesh.num_cells} cells")
    problem = sphere_into_block(mesh, np.array([0.0, DEPTH * RADIUS]))
    whole = 4.0 / float(hertz_force(np.array(DEPTH * RADIUS)))
    linear, green = (
        whole * float(solve_contact(problem, strain=strain).forces[-1, 0, 2])
        for strain in (Strain.LINEAR, Strain.GREEN)
    )
    return Level(edges_per_radius, mesh.num_cells, linear, green)


def vary_penalty(progress: Callable[[str], None]) -> list[Penalty]:
    """The force at 0.05 R under penalties of growing stiffness."""
    progress("penalties")
    mesh = scenes.indentation(4.0).problem.mesh
    problem = sphere_into_block(mesh, np.array([0.0, 0.05 * RADIUS]))
    exact = solve_contact(problem)
    out = []
    for layers in LAYERS:
        law = ContactLaw(ContactForm.PENALTY, exact.stiffnesses[0] * layers / 100.0)
        found = solve_contact(problem, law=law)
        force, limit = (float(r.forces[-1, 0, 2]) for r in (found, exact))
        depth = float(found.penetrations[-1, 0])
        out.append(Penalty(layers, found.stiffnesses[0], 1.0 - force / limit, depth))
    return out


def penalty_rates(penalties: Sequence[Penalty]) -> list[float]:
    """Exponents of what is lacking, from one stiffness to the next."""
    return [
        float(np.log(a.lack / b.lack) / np.log(b.stiffness / a.stiffness))
        for a, b in itertools.pairwise(penalties)
    ]
