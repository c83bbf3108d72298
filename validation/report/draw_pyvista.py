"""Child process: pictures by pyvista, off-screen. Arguments: fields.npz, folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from palpate.validation.report.pictures import GREEN, GREY, PANEL, RED, view_axis


def main() -> None:
    """Draw states.png and errors.png."""
    import pyvista

    source, folder = Path(sys.argv[1]), Path(sys.argv[2])
    with np.load(source) as stored:
        fields = {name: stored[name] for name in stored.files}
    points, facets = fields["points"], fields["facets"]
    strains = [s for s in ("linear", "green") if f"u_{s}" in fields]
    moved = [points + fields[f"u_{s}"] for s in strains]
    axis = view_axis(points, moved)
    camera = _camera(np.vstack([points, *moved]), axis)

    def body(place: Any) -> Any:
        return pyvista.PolyData.from_regular_faces(place, facets)

    largest = max(
        (float(np.linalg.norm(fields[f"u_{s}"], axis=1).max()) for s in strains), default=1.0
    )
    plotter = pyvista.Plotter(
        off_screen=True,
        shape=(1, 1 + len(strains)),
        window_size=(PANEL[0] * (1 + len(strains)), PANEL[1]),
        border=False,
    )
    plotter.set_background("white")
    plotter.subplot(0, 0)
    plotter.add_mesh(body(points), color=GREY, show_edges=True, edge_color="#8a8a8a", line_width=1)
    for name, colour in (("held", "#30558f"), ("pushed", RED)):
        if len(fields[name]):
            part = pyvista.PolyData.from_regular_faces(points, fields[name])
            plotter.add_mesh(part, color=colour, show_edges=True, edge_color="#8a8a8a")
    plotter.add_text("original (blue: held, red: pushed)", font_size=11, color="black")
    plotter.camera_position = camera
    for column, strain in enumerate(strains, start=1):
        plotter.subplot(0, column)
        shape = body(points + fields[f"u_{strain}"])
        shape["displacement [mm]"] = np.linalg.norm(fields[f"u_{strain}"], axis=1)
        plotter.add_mesh(
            shape,
            scalars="displacement [mm]",
            cmap="viridis",
            clim=(0.0, largest),
            show_edges=True,
            edge_color="#404040",
            line_width=0.5,
            show_scalar_bar=column == len(strains),
            scalar_bar_args=_bar("displacement [mm]"),
        )
        plotter.add_mesh(body(points), style="wireframe", color=GREEN, opacity=0.55, line_width=1)
        plotter.add_text(f"{strain} strain (green: original)", font_size=11, color="black")
        plotter.camera_position = camera
    plotter.screenshot(folder / "states.png")
    plotter.close()

    errors = [name for name in fields if name.startswith("error_") and name.endswith("green")]
    if not errors or "u_green" not in fields:
        return
    plotter = pyvista.Plotter(
        off_screen=True,
        shape=(1, len(errors)),
        window_size=(PANEL[0] * len(errors), PANEL[1]),
        border=False,
    )
    plotter.set_background("white")
    for column, name in enumerate(errors):
        plotter.subplot(0, column)
        shape = body(points + fields["u_green"])
        label = f"error [mm]{' ' * column}"
        shape[label] = fields[name]
        plotter.add_mesh(
            shape,
            scalars=label,
            cmap="magma_r",
            show_edges=True,
            edge_color="#404040",
            line_width=0.5,
            scalar_bar_args=_bar(label),
        )
        title = name.removeprefix("error_").removesuffix(", green")
        plotter.add_text(title, font_size=11, color="black")
        plotter.camera_position = camera
    plotter.screenshot(folder / "errors.png")
    plotter.close()


def _bar(title: str) -> dict[str, object]:
    """A colour bar below the body, clear of it."""
    return {
        "title": f"{title}\n",
        "vertical": False,
        "position_x": 0.2,
        "position_y": 0.03,
        "width": 0.6,
        "height": 0.09,
        "title_font_size": 18,
        "label_font_size": 15,
        "n_labels": 4,
        "fmt": "%.3g",
        "color": "black",
    }


def _camera(everything: Any, axis: int) -> list[tuple[float, float, float]]:
    """Look along an axis at all of the body and its motion, with room for title and bar."""
    low, high = everything.min(axis=0), everything.max(axis=0)
    centre = 0.5 * (low + high)
    across = [i for i in range(3) if i != axis]
    aspect = PANEL[0] / PANEL[1]
    extent = (high - low)[across]
    reach = max(float(extent[0]) / aspect, float(extent[1])) * 0.5 / np.tan(np.radians(15.0)) * 1.45
    direction = np.zeros(3)
    direction[axis] = -1.0 if axis == 1 else 1.0
    direction[across[0]] = 0.18
    direction /= np.linalg.norm(direction)
    up = (0.0, 1.0, 0.0) if axis == 2 else (0.0, 0.0, 1.0)
    focus = centre.copy()
    focus[across[1]] -= 0.02 * reach
    place = focus + direction * reach

    def triple(x: Any) -> tuple[float, float, float]:
        return float(x[0]), float(x[1]), float(x[2])

    return [triple(place), triple(focus), up]


if __name__ == "__main__":
    main()
