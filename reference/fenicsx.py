# ruff: noqa: E402 (the wheel must be found before its parts are imported)
"""Differences between dolfinx 0.5 and 0.11, and the communication between ranks.

The other modules work with both versions. Import dolfinx only through this module:

    from palpate.reference.fenicsx import PETSc, fem, ufl

Under mpirun every rank runs the same lines. A flat vector contains the entries that its rank owns;
sums and extremes over the whole body are taken by `total`, `smallest` and `largest`, which every
rank must call. A decision that one rank takes by its own numbers alone leaves the others waiting:
take it by `is_anywhere`.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import logging
import re
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from palpate.meshes.arrays import Floats, Indices, Points
from palpate.reference import availability
from palpate.reference.jit_cache import (
    cache_folder,
    check_forms,
    compiled_in,
    locked,
    note_forms,
    remove_unfinished,
)

availability.require_available()
if importlib.util.find_spec("dolfinx_solver"):
    # The PyPI wheel: finds libmpi and PETSc for the imports below.
    import dolfinx_solver  # noqa: F401
import dolfinx
import dolfinx.fem.petsc
import dolfinx.jit
import ufl as ufl
from dolfinx import fem as fem
from mpi4py import MPI as MPI
from petsc4py import PETSc as PETSc

# "0.11.0.post0" reads (0, 11).
VERSION: tuple[int, int] = tuple(int(n) for n in re.findall(r"\d+", dolfinx.__version__)[:2])  # type: ignore[assignment]
_IS_OLD = VERSION < (0, 6)

# The communicator of all ranks; without mpirun there is a single rank.
COMM = MPI.COMM_WORLD

if _IS_OLD:
    _ADD: Any = dolfinx.la.ScatterMode.add
else:
    _ADD = dolfinx.la.InsertMode.add

_VERSIONS = {**availability.versions(), "petsc": ".".join(map(str, PETSc.Sys.getVersion()))}
# -O2 without -march=native or -ffast-math: the same digits on every machine of an architecture.
_OPTIONS: dict[str, Any] = {"cffi_extra_compile_args": ["-O2", "-g0"]}
# How long the compiler waits for another process's form before it raises TimeoutError [s].
_PATIENCE, _PATIENCE_OF_RANKS = 1, 60
_Made = TypeVar("_Made")
_Given = ParamSpec("_Given")


def _compiles(make: Callable[_Given, _Made]) -> Callable[_Given, _Made]:
    """Let a function cache compiled forms in our folder, which other processes use too."""

    @functools.wraps(make)
    def made(*given: _Given.args, **named: _Given.kwargs) -> _Made:
        folder = cache_folder(dolfinx.__version__)
        if COMM.size == 1:
            with _compiler(folder, _PATIENCE):
                return compiled_in(folder, lambda: make(*given, **named))
        # Rank 0 compiles under the lock while the other ranks wait for its compiled forms.
        with locked(folder) if COMM.rank == 0 else contextlib.nullcontext():
            if COMM.rank == 0:
                remove_unfinished(folder)
                check_forms(folder)
            with _compiler(folder, _PATIENCE_OF_RANKS):
                compiled = make(*given, **named)
            if COMM.rank == 0:
                note_forms(folder)
            return compiled

    return made


@contextlib.contextmanager
def _compiler(folder: Path, patience: int) -> Iterator[None]:
    """Set the folder and the time limit [s] of the form compiler, and silence its log."""
    defaults = (
        dolfinx.jit.DOLFINX_DEFAULT_JIT_PARAMETERS
        if _IS_OLD
        else dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS
    )
    root = logging.getLogger()
    level, handlers, disabled = root.level, root.handlers[:], root.manager.disable
    before = {key: defaults[key] for key in ("cache_dir", "timeout")}
    with warnings.catch_warnings():
        # The old compiler uses names that numpy deprecates, and does not close its files.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", ResourceWarning)
        # dolfinx 0.5 has no options for the compilation of elements and coordinate maps.
        defaults["cache_dir"] = (folder, before["cache_dir"][1])
        defaults["timeout"] = (patience, before["timeout"][1])
        # cffi builds through setuptools, which reconfigures the root logger and logs every command.
        logging.disable(logging.INFO)
        try:
            yield
        finally:
            defaults.update(before)
            logging.disable(disabled)
            root.setLevel(level)
            root.handlers[:] = handlers


def versions() -> dict[str, str]:
    """Versions of Python, of the parts of FEniCSx and of PETSc, as text."""
    return dict(_VERSIONS)


def give_back_dropped() -> None:
    """Free the matrices, factors and vectors that Python has dropped; every rank calls it.

    PETSc frees an object only when all ranks agree that it is not needed; without this call a long
    run keeps the memory of every tangent. It is called where a mesh is created and where a system
    is solved, so that no other code has to.
    """
    PETSc.garbage_cleanup(COMM)


@_compiles
def create_mesh(points: Points, cells: np.ndarray[Any, Any]) -> Any:
    """Return a dolfinx mesh of linear tetrahedra, spread over the ranks; it renumbers both."""
    give_back_dropped()
    # Rank 0 passes the whole mesh; dolfinx distributes it.
    own_rows = slice(None) if COMM.rank == 0 else slice(0)
    x = np.ascontiguousarray(points[own_rows], dtype=np.float64)
    rows = np.ascontiguousarray(cells[own_rows], dtype=np.int64)
    if _IS_OLD:
        shape = ufl.Cell("tetrahedron", geometric_dimension=3)
        # FFCx gives a mesh this variant when it compiles its first form, but not when it finds that
        # form compiled: the names of all later forms would depend on which of the two happened.
        scalar = ufl.FiniteElement("Lagrange", shape, 1, variant="equispaced")
        domain = ufl.Mesh(ufl.VectorElement(scalar))
        no_ghosts = dolfinx.mesh.GhostMode.none
        return dolfinx.mesh.create_mesh(COMM, rows, x, domain, no_ghosts)
    import basix.ufl

    element = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
    return dolfinx.mesh.create_mesh(COMM, rows, element, x)


@_compiles
def function_space(mesh: Any, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
    """Return the space of scalars, of vectors (3,) or of tensors (3, 3) of a polynomial degree.

    Of the family "Lagrange", continuous; or "DG", which for degree 0 is constant in each cell.
    """
    if _IS_OLD:
        kinds = (fem.FunctionSpace, fem.VectorFunctionSpace, fem.TensorFunctionSpace)
        return kinds[len(shape)](mesh, (family, degree))
    return fem.functionspace(mesh, (family, degree, shape) if shape else (family, degree))


@_compiles
def taylor_hood_space(mesh: Any, degree: int, count: int = 1) -> Any:
    """Return the space of displacements of a degree with continuous scalars of one degree less.

    `count` is the number of scalars.
    """
    if _IS_OLD:
        cell = mesh.ufl_cell()
        parts = [
            ufl.VectorElement("Lagrange", cell, degree),
            *[ufl.FiniteElement("Lagrange", cell, degree - 1)] * count,
        ]
        return fem.FunctionSpace(mesh, ufl.MixedElement(parts))
    import basix.ufl

    return fem.functionspace(
        mesh,
        basix.ufl.mixed_element(
            [
                basix.ufl.element("Lagrange", "tetrahedron", degree, shape=(3,)),
                *[basix.ufl.element("Lagrange", "tetrahedron", degree - 1)] * count,
            ]
        ),
    )


@_compiles
def part_of_space(mixed: Any, part: int = 0) -> tuple[Any, np.ndarray[Any, Any]]:
    """Return a part of a mixed space as a separate space, and its dofs in the mixed space.

    dolfinx's `collapse` is not used: from degree 3 on an edge has two dofs, which it numbers along
    the direction of the edge in each cell (0.5.2 and 0.11), so that neighbours disagree.
    """
    if _IS_OLD:
        space = fem.FunctionSpace(mixed.mesh, mixed.ufl_element().sub_elements()[part])
    else:
        space = fem.functionspace(mixed.mesh, mixed.ufl_element().sub_elements[part])
    size = space.dofmap.bs
    there = mixed.sub(part).dofmap
    dofs = np.empty(size * num_local_blocks(space), dtype=np.int32)
    for cell, blocks in enumerate(cell_dofs(space)):
        own = (size * blocks[:, None] + np.arange(size)).ravel()
        dofs[own] = there.cell_dofs(cell)
    return space, dofs


def num_local_blocks(space: Any) -> int:
    """Number of nodes in the cells of this rank, including those that another rank owns."""
    index_map = space.dofmap.index_map
    return int(index_map.size_local + index_map.num_ghosts)


def cell_function(mesh: Any, values: Floats, space: Any = None) -> Any:
    """Return the function with a constant value in each cell, dolfinx numbering.

    `space` is the space of such functions, if there is one.
    """
    function = fem.Function(space or function_space(mesh, "DG", 0))
    set_cell_values(function, values)
    return function


def set_cell_values(function: Any, values: Floats) -> None:
    """Set the values of a `cell_function`, dolfinx numbering."""
    function.x.array[cell_dofs(function.function_space)[:, 0]] = values


def cell_values(function: Any) -> Floats:
    """Values of a `cell_function`, dolfinx numbering."""
    return np.array(function.x.array[cell_dofs(function.function_space)[:, 0]])


def quadrature(degree: int) -> tuple[Points, Floats]:
    """Points and weights of the reference tetrahedron for a form of this degree; they sum to 1."""
    import basix

    points, weights = basix.make_quadrature(basix.CellType.tetrahedron, degree)
    return np.asarray(points, dtype=np.float64), 6.0 * np.asarray(weights, dtype=np.float64)


@_compiles
def quadrature_space(mesh: Any, degree: int, size: int) -> Any:
    """Return the space of `size` values at each quadrature point of each cell.

    Degree 0, with one point, gives the space of vectors that are constant in each cell.
    """
    if _IS_OLD:
        family, cell = ("Quadrature" if degree else "DG"), mesh.ufl_cell()
        scheme = "default" if degree else None
        element = ufl.VectorElement(family, cell, degree, dim=size, quad_scheme=scheme)
        return fem.FunctionSpace(mesh, element)
    import basix.ufl

    if degree == 0:
        return fem.functionspace(mesh, ("DG", 0, (size,)))
    element = basix.ufl.quadrature_element("tetrahedron", (size,), degree=degree)
    return fem.functionspace(mesh, element)


def part_of(function: Any, space: Any, dofs: np.ndarray[Any, Any]) -> Any:
    """One part of a function of a mixed space; `space` and `dofs` as in `part_of_space`."""
    part = fem.Function(space)
    part.x.array[:] = function.x.array[dofs]
    return part


def values_at(function: Any, positions: Points, cells: np.ndarray[Any, Any]) -> Floats:
    """Values of a function at positions [m], each in a cell of this rank, shape (n, value_size)."""
    size = function.function_space.dofmap.bs
    if len(positions) == 0:
        return np.zeros((0, size))
    found = function.eval(positions, np.asarray(cells, dtype=np.int32))
    return np.asarray(found, dtype=np.float64).reshape(-1, size)


@_compiles
def form(expression: Any) -> Any:
    """Compile a UFL form, or take it from the cache."""
    if _IS_OLD:
        return fem.form(expression, jit_params=_OPTIONS)
    return fem.form(expression, jit_options=_OPTIONS)


def create_matrix(
    compiled: Any, groups: Sequence[Indices] = (), *, is_blocked: bool = False
) -> Any:
    """Return an empty PETSc matrix with the pattern of a compiled bilinear form.

    Args:
        compiled: The form.
        groups: Unknowns between which there is an entry each as well; on a single rank.
        is_blocked: Store blocks of a node each: of quadratic tetrahedra it is assembled twice as
            fast and multiplied 1.6 times as fast. Without groups only.
    """
    if not groups:
        return dolfinx.fem.petsc.create_matrix(compiled, "baij" if is_blocked else None)
    matrix = dolfinx.fem.petsc.create_matrix(compiled)
    # The assembly of a matrix without values would drop its pattern.
    assemble_into_matrix(matrix, compiled)
    starts, columns, _ = matrix.getValuesCSR()
    shape, blocks, maps = matrix.getSize(), matrix.getBlockSizes(), matrix.getLGMap()
    matrix.destroy()
    rows = np.repeat(np.arange(shape[0], dtype=np.int64), np.diff(starts))
    pairs = [(shape[1] * own[:, None].astype(np.int64) + own).ravel() for own in groups]
    entries = np.unique(np.concatenate([shape[1] * rows + columns, *pairs]))
    rows, columns = np.divmod(entries, shape[1])
    starts = np.searchsorted(rows, np.arange(shape[0] + 1))
    csr = (starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), np.zeros(len(columns)))
    wider = PETSc.Mat().createAIJ(shape, bsize=blocks, csr=csr, comm=COMM)
    wider.setLGMap(*maps)
    return wider


def in_rows(matrix: Any) -> Any:
    """A matrix of entries with the values of one of blocks; itself where it is one of entries."""
    return matrix.convert("aij", PETSc.Mat()) if "baij" in matrix.getType() else matrix


def product(matrix: Any, values: Floats) -> Floats:
    """A PETSc matrix times a flat vector, the entries that this rank owns."""
    x, b = matrix.createVecs()
    x.array[:] = values
    matrix.mult(x, b)
    found: Floats = np.array(b.array)
    x.destroy()
    b.destroy()
    return found


def assemble_into_matrix(matrix: Any, compiled: Any) -> None:
    """Add a compiled bilinear form to a PETSc matrix, without constraints."""
    dolfinx.fem.petsc.assemble_matrix(matrix, compiled)
    matrix.assemble()


def assemble_vector(compiled: Any) -> Floats:
    """Assemble a compiled linear form; flat, the entries that this rank owns."""
    vector = fem.assemble_vector(compiled)
    space = compiled.function_spaces[0]
    num_owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    if COMM.size > 1:
        vector.scatter_reverse(_ADD)
    return np.array(vector.array[:num_owned])


def assemble_scalar(compiled: Any) -> float:
    """Integrate a compiled functional over the whole body."""
    return float(total(float(fem.assemble_scalar(compiled))))


def total(value: Any) -> Any:
    """Sum of a number or an array over the ranks, the same on each."""
    return COMM.allreduce(value, MPI.SUM)


def smallest(value: float) -> float:
    """Smallest of the ranks' numbers; NaN where any is NaN."""
    return -largest(-value)


def largest(value: float) -> float:
    """Largest of the ranks' numbers; NaN where any is NaN."""
    if COMM.size == 1:
        return value
    return float(np.max(COMM.allgather(value)))


def norm(values: Floats) -> float:
    """Euclidean norm of a flat vector over all ranks."""
    if COMM.size == 1:
        return float(np.linalg.norm(values))
    return float(np.sqrt(total(float(values @ values))))


def cell_dofs(space: Any) -> np.ndarray[Any, Any]:
    """Blocked dofs of each cell, shape (num_cells, dofs_per_cell)."""
    return _table(space.dofmap.list, space.mesh)


def cell_nodes(mesh: Any) -> np.ndarray[Any, Any]:
    """Geometry nodes of each cell, shape (num_cells, 4)."""
    return _table(mesh.geometry.dofmap if _IS_OLD else mesh.geometry.dofmaps[0], mesh)


def _table(rows: Any, mesh: Any) -> np.ndarray[Any, Any]:
    num_cells = mesh.topology.index_map(3).size_local
    # An adjacency list in 0.5, an array in 0.11.
    return np.asarray(getattr(rows, "array", rows)).reshape(num_cells, -1)


@_compiles
def evaluate_in_cells(
    mesh: Any, expression: Any, reference_points: Points
) -> Callable[..., np.ndarray[Any, Any]]:
    """Compile an expression to be evaluated at points of every cell, dolfinx numbering.

    Returns:
        A function for its present values, shape (num_cells, num_points * value_size); in some
        cells only, if their numbers are given.
    """
    every = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    points = np.ascontiguousarray(reference_points)
    if _IS_OLD:
        old = fem.Expression(expression, points, jit_params=_OPTIONS)
        return lambda cells=every: np.asarray(old.eval(cells)).reshape(len(cells), -1)
    new = fem.Expression(expression, points, jit_options=_OPTIONS)
    return lambda cells=every: np.asarray(new.eval(mesh, cells)).reshape(len(cells), -1)


def meshtags(
    mesh: Any, dimension: int, entities: np.ndarray[Any, Any], values: np.ndarray[Any, Any]
) -> Any:
    """Return tags of mesh entities (sorted, as both versions require)."""
    return dolfinx.mesh.meshtags(mesh, dimension, entities, values)


# A rank with an error waits this long for the other ranks to have an error too [s].
PATIENCE = 10.0
_POLL = 0.005  # [s]
# Communicator of ranks with an error: a separate one, since the others may be in any other call.
_TROUBLE = COMM.Dup()


def is_anywhere(value: bool) -> bool:
    """Whether the value is true on any rank."""
    return value if COMM.size == 1 else bool(COMM.allreduce(value, MPI.LOR))


def all_rows(rows: Floats) -> Floats:
    """The rows of all ranks, those of rank 0 first."""
    return rows if COMM.size == 1 else np.concatenate(COMM.allgather(rows))


def different_rows(rows: Floats) -> Floats:
    """The distinct rows of a table over all ranks, sorted."""
    return np.unique(all_rows(np.unique(rows, axis=0)), axis=0)


def exchange(parts: list[Any]) -> list[Any]:
    """Send each rank its part; return the parts received, in the order of the ranks."""
    return parts if COMM.size == 1 else list(COMM.alltoall(parts))


def last_offered(value: Any, is_offered: bool) -> Any:
    """The value of the last rank on which `is_offered`."""
    return [v for v in COMM.allgather(value if is_offered else None) if v is not None][-1]


def is_met_by_all() -> bool:
    """Whether all ranks have an error: a rank with one calls this and waits for the others.

    False where only some ranks have. They must not go on then: the others wait for them elsewhere.
    """
    return COMM.size == 1 or comes(_TROUBLE.Ibarrier())


def comes(request: Any) -> bool:
    """Whether an MPI request completes within PATIENCE."""
    deadline = time.monotonic() + PATIENCE
    while not request.Test():
        if time.monotonic() > deadline:
            return False
        time.sleep(_POLL)
    return True
