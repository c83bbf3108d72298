"""Tables and figures of the study of contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.problem import Strain
from palpate.validation.report.study_page import StudyFigure, StudyTable
from palpate.validation.studies import contact_scenes as scenes
from palpate.validation.studies.contact_hertz import RADIUS, hertz_force
from palpate.validation.studies.contact_runs import DEPTH, Outcome


def level_table(found: Outcome) -> StudyTable:
    """Force over Hertz' at 0.01 R by mesh."""
    rows = [
        [f"{level.edges_per_radius:.2f}", str(level.cells), f"{level.linear:.4f}",
         f"{level.green:.4f}", f"{level.green / level.linear:.4f}"]
        for level in found.levels
    ]  # fmt: skip
    columns = ["edges in the contact radius", "cells", "linear / Hertz", "Green / Hertz",
               "Green / linear"]  # fmt: skip
    return StudyTable(f"Force over Hertz' at d = {DEPTH:g} R", columns, rows)


def curve_table(found: Outcome) -> StudyTable:
    """Force against depth of the sphere."""
    linear, green = (_forces(found, strain) for strain in (Strain.LINEAR, Strain.GREEN))
    rows = []
    for k, depth in enumerate(scenes.DEPTHS):
        hertz = float(hertz_force(np.array(depth * RADIUS)))
        row = [f"{depth:g}", f"{1e3 * hertz:.4f}"]
        for forces in (linear, green):
            row += [f"{1e3 * forces[k] + 0.0:.4f}" if k < len(forces) else "-"]
            row += [f"{forces[k] / hertz:.4f}" if 0 < k < len(forces) else "-"]
        rows.append(row)
    columns = ["d / R", "Hertz [mN]", "linear [mN]", "over Hertz", "Green [mN]", "over Hertz"]
    return StudyTable("Sphere into a block: force against depth", columns, rows)


def pair_table(found: Outcome) -> StudyTable:
    """Every scene beside the reference."""
    rows = [
        [p.scene, str(p.strain), str(p.cells), f"{np.linalg.norm(p.forces[-1]):.5g}",
         f"{p.force_error:.1e}", f"{p.displacement_error:.1e}", f"{p.volume_error:.1e}"]
        for p in found.pairs
    ]  # fmt: skip
    columns = ["scene", "strain", "cells", "last force [N]", "force error", "displacement error",
               "volume change error"]  # fmt: skip
    return StudyTable("fastsim and the reference on the same mesh", columns, rows)


def penalty_table(found: Outcome) -> StudyTable:
    """What penalties lack."""
    rows = [
        [f"{p.layers:g}", f"{p.stiffness:.3g}", f"{p.lack:.3e}", f"{1e6 * p.penetration:.2f}"]
        for p in found.penalties
    ]
    columns = ["k [layers of cells]", "k [Pa/m]", "force lacking [-]", "penetration [um]"]
    return StudyTable("Penalties, at d = 0.05 R", columns, rows)


def speed_table(found: Outcome) -> StudyTable:
    """Seconds per step and real-time factors."""
    rows = []
    for speed in found.speeds:
        factors = speed.real_time_factors
        for k, kind in enumerate(("no tool", "constraint", "penalty", "self-collision")):
            added = "-" if k == 0 else f"{speed.shares[k - 1]:+.1%}"
            rows.append([f"{kind}, {speed.cells} cells", f"{1e6 * speed.seconds[k]:.1f}", added,
                         f"{factors[k]:.2f}"])  # fmt: skip
    columns = ["kidney, one core, single precision", "step [us]", "added", "times real time"]
    return StudyTable("Steps with a capsule that slides over the kidney", columns, rows)


def draw(found: Outcome, hertz_limit: float) -> list[StudyFigure]:
    """Force against depth; distance from Hertz by mesh, and what penalties lack."""
    from matplotlib import pyplot
    from matplotlib.ticker import NullFormatter

    from palpate.validation.report.plots import figure_svg

    figure, axes = pyplot.subplots(figsize=(6.4, 4.2))
    depth = np.linspace(0.0, scenes.DEPTHS[-1], 100)
    axes.plot(depth, 1e3 * hertz_force(depth * RADIUS), "k--", lw=1, label="Hertz")
    for strain, colour in ((Strain.LINEAR, "#2f6f8f"), (Strain.GREEN, "#b5332e")):
        forces = _forces(found, strain)
        label = f"{strain} strain (reference: the same)"
        axes.plot(scenes.DEPTHS[: len(forces)], 1e3 * forces, "-o", ms=4, color=colour, label=label)
    axes.set_xlabel("depth / radius")
    axes.set_ylabel("force [mN]")
    axes.legend(frameon=False, fontsize=8)
    axes.grid(color="#dddddd", lw=0.6)
    figure.tight_layout()
    curve = StudyFigure(figure_svg(figure), "A sphere of 10 mm pressed into a block of 5 kPa.")
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.6, 3.8))
    edges = [level.edges_per_radius for level in found.levels]
    left.loglog(edges, [100 * abs(level.linear - 1.0) for level in found.levels], "-o", ms=4)
    left.axhline(100 * hertz_limit, color="black", lw=0.8, ls=":")
    left.set_xlabel("edges in the contact radius")
    left.set_ylabel("linear strain from Hertz [%]")
    stiffness = [p.stiffness for p in found.penalties]
    right.loglog(stiffness, [100 * p.lack for p in found.penalties], "-o", ms=4)
    right.set_xlabel("penalty stiffness [Pa/m]")
    # Labels of the steps between the powers of ten would lie on one another.
    right.xaxis.set_minor_formatter(NullFormatter())
    left.set_xticks(edges, [f"{edge:.3g}" for edge in edges])
    left.xaxis.set_minor_formatter(NullFormatter())
    right.set_ylabel("force lacking [%]")
    for axes in (left, right):
        axes.grid(color="#dddddd", lw=0.6, which="both", alpha=0.6)
    figure.tight_layout()
    caption = "Left: all edges shrink together (dotted: the limit). Right: penalties, first order."
    return [curve, StudyFigure(figure_svg(figure), caption)]


def _forces(found: Outcome, strain: Strain) -> NDArray[np.float64]:
    """Whole forces of the indentation along z [N]."""
    pair = next(p for p in found.pairs if p.scene == "sphere into block" and p.strain is strain)
    return np.array(pair.forces)[:, 2]


def bodies_table(found: Outcome) -> StudyTable:
    """How deep the bar is in itself, by penalty."""
    bar = found.fold
    rows = [["none", f"{bar.free:.3f}"]]
    rows += [[f"{k:.3g}", f"{g:.3f}"] for k, g in zip(bar.stiffnesses, bar.depths, strict=True)]
    columns = ["penalty [Pa/m]", "deepest vertex [edges]"]
    return StudyTable("A folded bar on itself", columns, rows)
