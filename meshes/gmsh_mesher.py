"""An independent mesher: gmsh fills a closed surface, keeping its facets.

gmsh runs in a process of its own, with a time limit, since it aborts or hangs on some bad input.
Self-intersection is not checked here: that needs exact predicates, which the caller has (see
`require_no_self_intersection` of `palpate.fastsim.surface_remesher`).
"""

from __future__ import annotations

import argparse
import subprocess
import sys

import numpy as np

from palpate.meshes.arrays import Indices, Points
from palpate.meshes.errors import MeshError
from palpate.meshes.shells import ShellKind, find_shells
from palpate.meshes.supervised import run_supervised
from palpate.meshes.surface_checks import require_closed
from palpate.meshes.temporaries import scratch_folder
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface


class MesherFailedError(MeshError):
    """The mesher gave no usable mesh; the message contains its own."""


def mesh_with_gmsh(
    surface: TriSurface, *, edge_length: float | None = None, time_limit: float = 300.0
) -> TetMesh:
    """Fill a closed surface with tetrahedra by gmsh (Delaunay, with Netgen's optimiser).

    Args:
        surface: Closed surface [m] without self-intersection: outer walls, cavities, bodies within
            cavities.
        edge_length: Wanted edge length inside [m]; None takes the surface's.
        time_limit: Seconds before gmsh is ended.

    Returns:
        A mesh whose boundary facets are exactly the surface's, points in its order first.

    Raises:
        SurfaceError: The surface does not bound a solid.
        MesherFailedError: gmsh is missing, failed, ran out of time, or changed the boundary.
    """
    require_closed(surface)
    with scratch_folder("gmsh") as folder:
        source, target = folder / "surface.npz", folder / "mesh.npz"
        np.savez(source, points=surface.points, facets=surface.facets)
        command = [sys.executable, "-m", "palpate.meshes.gmsh_mesher", str(source), str(target)]
        command += [] if edge_length is None else ["--edge-length", repr(float(edge_length))]
        try:
            done = run_supervised(command, time_limit=time_limit)
        except subprocess.TimeoutExpired:
            raise MesherFailedError(
                f"gmsh did not end within {time_limit:g} s; use a larger edge length or limit"
            ) from None
        if done.returncode != 0 or not target.exists():
            said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
            raise MesherFailedError(f"gmsh gave no mesh (exit {done.returncode}): {said[:300]}")
        with np.load(target) as stored:
            points, cells = stored["points"], stored["cells"]
    mesh = TetMesh(points, cells)
    wanted = {tuple(sorted(row)) for row in surface.facets.tolist()}
    found = {tuple(sorted(row)) for row in mesh.boundary_facets.tolist()}
    if wanted != found:
        raise MesherFailedError(
            f"gmsh changed the boundary: {len(wanted - found)} facet(s) lost, "
            f"{len(found - wanted)} new; use mesher fastsim, or a finer surface"
        )
    return mesh


def _fill(points: Points, facets: Indices, edge_length: float | None) -> tuple[Points, Indices]:
    """Run gmsh on every solid of the surface; used points first, in the surface's order."""
    import gmsh

    if edge_length is None:
        corners = points[facets]
        edge_length = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
    gmsh.initialize([], interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 2)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.Algorithm3D", 1)
        gmsh.option.setNumber("Mesh.Optimize", 1)
        gmsh.option.setNumber("Mesh.OptimizeNetgen", 1)
        # Sizes come from the edges of the surface, not from points or curvature.
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.3 * edge_length)
        used = np.unique(facets)
        shells = find_shells(TriSurface(points, facets))
        for tag, shell in enumerate(shells, start=1):
            rows = facets[shell.facets]
            own = np.unique(rows)
            gmsh.model.addDiscreteEntity(2, tag)
            gmsh.model.mesh.addNodes(2, tag, (own + 1).tolist(), points[own].ravel().tolist())
            gmsh.model.mesh.addElementsByType(tag, 2, [], (rows + 1).ravel().tolist())
            gmsh.model.geo.addSurfaceLoop([tag], tag)
        for which, shell in enumerate(shells):
            if shell.kind is ShellKind.CAVITY:
                continue
            # Its cavities lie in it and in the shells around it, and in no other shell.
            nest = {which, *shell.around}
            holes = [k for k, other in enumerate(shells) if set(other.around) == nest]
            gmsh.model.geo.addVolume([which + 1, *(k + 1 for k in holes)])
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.generate(3)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, connectivity = gmsh.model.mesh.getElementsByType(4)
    finally:
        gmsh.finalize()
    if len(connectivity) == 0:
        raise MesherFailedError("gmsh returned no tetrahedra")
    cells = np.asarray(connectivity, dtype=np.int64).reshape(-1, 4) - 1
    number = np.asarray(tags, dtype=np.int64) - 1
    position = np.full((int(number.max()) + 1, 3), np.nan)
    position[number] = np.asarray(coordinates).reshape(-1, 3)
    position[: len(points)][used] = points[used]
    inside = np.setdiff1d(np.unique(cells), used)
    order = np.concatenate([used, inside])
    renumber = np.full(len(position), -1)
    renumber[order] = np.arange(len(order))
    return position[order], renumber[cells].astype(np.int32)


def _main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("source")
    parser.add_argument("target")
    parser.add_argument("--edge-length", type=float)
    arguments = parser.parse_args()
    with np.load(arguments.source) as stored:
        points, facets = stored["points"], stored["facets"]
    try:
        filled_points, cells = _fill(points, facets, arguments.edge_length)
    except ImportError as error:
        print(f"gmsh is not installed ({error}); pip install gmsh", file=sys.stderr)
        return 3
    except Exception as error:  # gmsh raises plain Exception with its last message
        print(str(error) or type(error).__name__, file=sys.stderr)
        return 4
    np.savez(arguments.target, points=filled_points, cells=cells)
    return 0


if __name__ == "__main__":
    sys.exit(_main())
