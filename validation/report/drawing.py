"""Still pictures: surfaces, arrows and paths as plain data, and their drawing by matplotlib."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import patches
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.validation.exchange.nodal_arrays import are_among
from palpate.validation.report.plots import Medium, plot_style

GREEN, BLUE, RED, GREY, TAN, OCHRE = (
    "#2f8f4e", "#30558f", "#b5332e", "#d9d9d9", "#e3d9d0", "#c98a12",
)  # fmt: skip
_EDGES = "#6e6660"
# A tool may reach beyond the bodies by this fraction of their size before the frame cuts it; one
# that is no larger than so many of their sizes is whole.
BEYOND, WHOLE = 0.3, 1.5
_ABOVE = np.array([0.0, 0.0, 0.6])
# A facet that faces away from the light has this fraction of its colour.
_SHADE = 0.62
# Edges on coloured facets are this much darker; an outline is as wide as this part of all that is
# drawn, and follows creases of more than so many degrees.
_DARKER, _RIBBON, _CREASE = 0.88, 0.006, 50.0
# More facets than this are drawn as pixels in a vector figure, which else takes megabytes.
_MOST_FACETS = 20_000
# Characters of a legend that fit under one view, and those that the patch of a colour takes.
_CHARACTERS, _HANDLE = 60, 6


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in one colour, or in those of a value at each point, shown with a colour bar.

    The bar is called `values_name`, ends at `largest`, and has the `colours` of matplotlib. With
    `is_outline` only its rim and its contour are drawn, in the colour. A tool `is_beside`: it may
    leave the frame, and widens it by `BEYOND` at most where it is larger than `WHOLE`.
    """

    points: Points
    facets: Indices
    colour: str = GREY
    values: Floats | None = None
    values_name: str = ""
    largest: float = 1.0
    colours: str = "viridis"
    opacity: float = 1.0
    is_outline: bool = False
    is_beside: bool = False


@dataclass(frozen=True, eq=False)
class Marks:
    """Arrows (starts and vectors), a path, or single points, in one colour."""

    points: Points
    colour: str
    vectors: Points | None = None
    is_path: bool = False


@dataclass(frozen=True, eq=False)
class View:
    """A view of a body from one side, with marks in front of it, and a legend of words and colours.

    `unit` is that of the extents that are written beside the body; "" for no extents.
    """

    title: str
    surfaces: Sequence[Surface]
    side: tuple[float, float, float]
    marks: Sequence[Marks] = ()
    unit: str = ""
    legend: Sequence[tuple[str, str]] = ()

    @property
    def reached(self) -> Points:
        """All positions that are drawn, except those of tools, (n, 3)."""
        heads = [m.points + m.vectors for m in self.marks if m.vectors is not None]
        starts = [m.points for m in self.marks]
        return np.vstack([*(s.points for s in self.surfaces if not s.is_beside), *starts, *heads])


@dataclass(frozen=True)
class _Size:
    """Sizes of a picture: a view [inches], text and lines [points], and pixels per inch."""

    wide: float
    high: float
    font: float
    line: float
    dpi: int

    @property
    def row(self) -> float:
        """Height of a letter as a fraction of the picture's height."""
        return self.font / (72.0 * self.high)


def _size_of(form: str, num_views: int) -> _Size:
    """Sizes for a page, or for paper: one column is 88 mm wide, two are 180 mm."""
    if form == "small":  # beside text: its own letters are as large as those there
        return _Size(3.1, 4.0, 8.5, 0.7, 176)
    if form == "png":
        return _Size(6.2, 7.0, 11.0, 1.0, 110)
    wide = 3.46 if num_views == 1 else 7.09 / num_views
    return _Size(wide, max(1.25 * wide, 2.2), 7.0 if num_views < 4 else 6.0, 0.5, 300)


def extent(views: Sequence[View]) -> tuple[Points, Points]:
    """Lowest and highest corner of all that is drawn; of tools, as far as the frame shows them."""
    reached = np.vstack([view.reached for view in views])
    low, high = reached.min(axis=0), reached.max(axis=0)
    size = float((high - low).max())
    beside = [s.points for view in views for s in view.surfaces if s.is_beside]
    for points in beside:
        beyond = size * (1.0 if np.ptp(points, axis=0).max() <= WHOLE * size else BEYOND)
        low = np.minimum(low, np.maximum(points.min(axis=0), reached.min(axis=0) - beyond))
        high = np.maximum(high, np.minimum(points.max(axis=0), reached.max(axis=0) + beyond))
    return low, high


def draw(pictures: Mapping[str, Sequence[View]], form: str = "png") -> dict[str, bytes]:
    """Draw each picture, its views side by side; the bytes are the same for the same views.

    The form is "png", "small" (PNG, for half of a page's width and less), or "pdf" and "svg" in the
    width of a paper's columns, text as text.
    """
    made = {}
    for name, views in pictures.items():
        size = _size_of(form, len(views))
        with plot_style(Medium(size.wide * len(views), size.font)):
            figure = _figure(views, size)
            date = {"pdf": "CreationDate", "svg": "Date"}.get(form)
            data = io.BytesIO()
            kind = "png" if form == "small" else form
            figure.savefig(data, format=kind, metadata={date: None} if date else None)
        made[name] = data.getvalue()
    return made


def _figure(views: Sequence[View], size: _Size) -> Figure:
    figure = Figure(figsize=(size.wide * len(views), size.high), dpi=size.dpi)
    for column, view in enumerate(views):
        left, wide = column / len(views), 1.0 / len(views)
        low = 7.2 * size.row + _raised(view, size)
        above = (3.5 if view.title else 0.5) * size.row
        box = (left, low, wide, 1.0 - above - low)
        axes = figure.add_axes(box, projection="3d")
        _draw(axes, view, views, size)
    words = [entry for view in views for entry in view.legend]
    if words:
        handles = [patches.Patch(color=colour, label=label) for label, colour in words]
        written = sum(len(label) + _HANDLE for label, _ in words)
        rows = -(-written // (_CHARACTERS * len(views)))
        figure.legend(
            handles=handles, loc="lower center", ncols=-(-len(handles) // rows), frameon=False
        )
    return figure


def _draw(axes: Any, view: View, views: Sequence[View], size: _Size) -> None:
    axes.set_proj_type("ortho")
    eye = np.array(view.side) / np.linalg.norm(view.side)
    arrows = [_arrow(marks) for marks in view.marks if marks.vectors is not None]
    low, high = extent(views)
    reach = float((high - low).max())
    # Only within one collection are triangles sorted by depth. One sees through tools: they come
    # after the body, without the facets that it hides.
    bodies = [part for part in (*view.surfaces, *arrows) if not part.is_beside]
    tools = [in_front(part, bodies, eye) for part in view.surfaces if part.is_beside]
    for order, parts in enumerate((bodies, tools)):
        if not parts:
            continue
        faces, paints, edges = zip(*(_faces(part, eye, reach) for part in parts), strict=True)
        drawn = Poly3DCollection(
            np.concatenate(faces),
            facecolor=np.vstack(paints),
            edgecolor=np.vstack(edges),
            linewidth=0.25 * size.line,
            zorder=order,
        )
        drawn.set_rasterized(sum(map(len, faces)) > _MOST_FACETS)
        axes.add_collection3d(drawn)
    for marks in view.marks:
        _add_marks(axes, marks, size.line)
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
        getattr(axes, f"set_{axis}label")(
            f"{axis} [{view.unit}]", fontsize=0.9 * size.font, labelpad=0.8 * size.font
        )
        getattr(axes, f"{axis}axis").set_major_locator(mpl.ticker.MaxNLocator(4))
    sides = tuple(np.maximum(high - low, 1e-9))
    axes.set_box_aspect(sides)
    axes.tick_params(labelsize=0.8 * size.font)
    if not view.unit:
        axes.set_axis_off()
    x, y, z = view.side
    height, azimuth = np.degrees([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])
    axes.view_init(elev=float(height), azim=float(azimuth))
    if not any(each.unit for each in views):
        axes.set_box_aspect(sides, zoom=_zoom(axes, views))
    letters = int(size.wide * 72.0 / (0.62 * size.font))
    axes.set_title("\n".join(textwrap.wrap(view.title, letters)), fontsize=size.font)
    for part in view.surfaces:
        if part.values is not None:
            _add_bar(axes, part, size, _raised(view, size))


def _raised(view: View, size: _Size) -> float:
    """By how much a colour bar stands higher, as a fraction, where a legend is below it."""
    has_bar = any(part.values is not None for part in view.surfaces)
    return 2.2 * size.row if has_bar and view.legend else 0.0


def _add_bar(axes: Any, part: Surface, size: _Size, raised: float) -> None:
    """Add a colour bar of a surface's values below it."""
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, part.largest), part.colours)
    above = axes.get_position()
    left, wide = above.x0 + 0.22 * above.width, 0.56 * above.width
    below = axes.figure.add_axes((left, 5.8 * size.row + raised, wide, size.row))
    bar = axes.figure.colorbar(scale, cax=below, orientation="horizontal")
    bar.set_label(part.values_name, fontsize=0.9 * size.font)
    bar.locator = mpl.ticker.MaxNLocator(3)
    bar.formatter = lambda value, _position: f"{value:.3g}"
    bar.solids.set(rasterized=False, edgecolor="face")
    bar.outline.set_linewidth(0.5 * size.line)
    bar.ax.tick_params(width=0.5 * size.line)
    bar.update_ticks()


def _zoom(axes: Any, views: Sequence[View]) -> float:
    """The zoom by which the drawing fills the axes: matplotlib's own leaves half of them empty."""
    points = np.vstack([view.reached for view in views])
    low, high = extent(views)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    tools = any(part.is_beside for view in views for part in view.surfaces)
    x, y, _ = proj3d.proj_transform(*(corners if tools else points).T, axes.get_proj())
    limits = axes.viewLim
    fills = [np.abs(x - 0.5 * (limits.x0 + limits.x1)).max() / (0.5 * limits.width)]
    fills.append(np.abs(y - 0.5 * (limits.y0 + limits.y1)).max() / (0.5 * limits.height))
    return float(0.97 / max(fills))


def _faces(surface: Surface, eye: Floats, reach: float) -> tuple[Floats, Floats, Floats]:
    """Corners of the facets that are seen, their colours and those of their edges.

    A transparent body shows all facets, anything else those that face the eye; they are shaded by a
    light that comes from the eye and from above. `reach` is the size of all that is drawn.
    """
    if surface.is_outline:
        corners = _ribbons(surface, eye, reach)
        paint = np.tile(mpl.colors.to_rgba(surface.colour), (len(corners), 1))
        return corners, paint, paint
    corners = surface.points[surface.facets]
    normals = _normals(corners)
    is_whole = surface.opacity == 1.0 or surface.is_beside
    rows = normals @ eye > 0.0 if is_whole else np.ones(len(corners), dtype=bool)
    corners, count = corners[rows], int(rows.sum())
    if surface.values is None:
        paint = np.tile(mpl.colors.to_rgba(surface.colour, surface.opacity), (count, 1))
    else:
        shown = surface.values[surface.facets[rows]].mean(axis=1) / (surface.largest or 1.0)
        paint = mpl.colormaps[surface.colours](shown)
    light = eye + _ABOVE
    facing = np.maximum(normals[rows] @ (light / np.linalg.norm(light)), 0.0)
    paint[:, :3] *= (_SHADE + (1.0 - _SHADE) * facing)[:, None]
    if surface.values is not None:  # a mesh over colours would be read as part of them
        return corners, paint, np.column_stack([_DARKER * paint[:, :3], paint[:, 3]])
    return corners, paint, np.tile(mpl.colors.to_rgba(_EDGES, 0.5), (count, 1))


def _normals(corners: Floats) -> Floats:
    """Unit normals of triangles (n, 3, 3); zero of one without an area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: Floats = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return unit


def _ribbons(surface: Surface, eye: Floats, reach: float) -> Floats:
    """Thin triangles (n, 3, 3) across the eye along the rim, contour and creases of what faces it.

    They lie before the surface by an edge's length, so that the sorting by depth shows them whole.
    """
    facing = _normals(surface.points[surface.facets])
    seen = facing @ eye > 0.0
    facets, normals = surface.facets[seen], facing[seen]
    sides = np.sort(facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, of = np.unique(sides, axis=0, return_inverse=True)
    count = np.bincount(of.ravel(), minlength=len(edges))
    total = np.zeros((len(edges), 3))
    np.add.at(total, of.ravel(), np.repeat(normals, 3, axis=0))
    # Two unit normals that are at an angle a to one another add up to 2 cos(a / 2).
    is_crease = np.linalg.norm(total, axis=1) < 2.0 * np.cos(0.5 * np.radians(_CREASE))
    edges = edges[(count == 1) | is_crease]
    ends = surface.points[edges]
    along = ends[:, 1] - ends[:, 0]
    across = np.cross(along, eye)
    across *= 0.5 * _RIBBON * reach / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    ends = ends + (np.linalg.norm(along, axis=1)[:, None] * eye)[:, None, :]
    a, b, c, d = (ends[:, k] + way * across for k, way in ((0, -1), (1, -1), (1, 1), (0, 1)))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def in_front(tool: Surface, bodies: Sequence[Surface], eye: Floats) -> Surface:
    """A tool without the facets whose middles solid bodies hide from the eye."""
    solid = [b for b in bodies if b.opacity == 1.0 and not b.is_outline and len(b.facets)]
    if not solid:
        return tool
    corners = np.concatenate([b.points[b.facets] for b in solid])
    right = np.linalg.svd(eye[None])[2][1]
    up = np.cross(eye, right)
    frame = np.stack([right, up], axis=1)
    flat, depth = corners @ frame, corners @ eye
    middles = tool.points[tool.facets].mean(axis=1)
    at, height = middles @ frame, middles @ eye
    (ax, ay), (bx, by), (cx, cy) = (flat[:, k].T for k in range(3))
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    area = np.where(np.abs(area) > 0.0, area, np.inf)
    is_hidden = np.zeros(len(middles), dtype=bool)
    for row, ((x, y), z) in enumerate(zip(at, height, strict=True)):
        u = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
        v = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
        over = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & np.isfinite(area)
        above = depth[:, 0] + u * (depth[:, 1] - depth[:, 0]) + v * (depth[:, 2] - depth[:, 0])
        is_hidden[row] = bool((above[over] > z).any())
    return replace(tool, facets=tool.facets[~is_hidden])


def _arrow(marks: Marks) -> Surface:
    """Arrows as solids: a shaft of eight sides and a cone."""
    assert marks.vectors is not None
    angles = 0.25 * np.pi * np.arange(8)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    k = np.arange(8)
    quads = np.stack([k, (k + 1) % 8, k + 8, (k + 1) % 8 + 8], axis=1)
    band = np.concatenate([quads[:, [0, 1, 2]], quads[:, [1, 3, 2]]])
    rings = np.concatenate([band, band + 8, band + 16])
    points, facets = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int32)]
    for start, vector in zip(marks.points, marks.vectors, strict=True):
        length = float(np.linalg.norm(vector))
        if length > 0.0:
            facets.append(rings + sum(map(len, points)))
            across = np.linalg.svd(vector[None])[2][1:]
            across[1] *= np.sign(np.linalg.det(np.vstack([across, vector])))
            for along, wide in ((0.0, 0.03), (0.7, 0.03), (0.7, 0.09), (1.0, 0.0)):
                points.append(start + along * vector + length * wide * around @ across)
    return Surface(np.vstack(points), np.vstack(facets), marks.colour)


def _add_marks(axes: Any, marks: Marks, line: float) -> None:
    if marks.is_path:
        axes.plot(*marks.points.T, color=marks.colour, lw=1.5 * line)
    elif marks.vectors is None:
        axes.scatter(*marks.points.T, color=marks.colour, s=50 * line**2)


def joined(parts: Iterable[Indices | None]) -> Indices:
    """Facets of several parts, (num_facets, 3); a part that is None has none."""
    known = [part for part in parts if part is not None]
    return np.vstack([np.zeros((0, 3), dtype=np.int32), *known])


def boundary(points: Points, facets: Indices, fixed: Indices, pushed: Indices) -> list[Surface]:
    """A body's boundary: fixed facets are blue, loaded ones red, the rest has a colour of skin."""
    is_fixed, is_pushed = (are_among(facets, part) for part in (fixed, pushed))
    kinds = ((~is_fixed & ~is_pushed, TAN), (is_pushed & ~is_fixed, RED), (is_fixed, BLUE))
    return [Surface(points, facets[rows], colour) for rows, colour in kinds if rows.any()]
