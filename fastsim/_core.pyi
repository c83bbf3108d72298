"""Compiled core of palpate.fastsim."""

from collections.abc import Sequence
from enum import Enum
from typing import overload

import numpy as np
from numpy.typing import NDArray

__version__: str

class StrainMeasure(Enum):
    linear = 0
    green = 1

class SolveStatus(Enum):
    converged = 0
    negative_curvature = 1
    iteration_limit = 2

class ElasticBody:
    def __init__(
        self,
        points: NDArray[np.float64],
        cells: NDArray[np.int32],
        lmbda: float,
        mu: float,
        strain: StrainMeasure,
    ) -> None: ...
    def shape_gradients(self) -> NDArray[np.float64]: ...
    def displacement_gradients(
        self, displacement: NDArray[np.float64]
    ) -> NDArray[np.float64]: ...
    def internal_force(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def strain_energy(self, displacement: NDArray[np.float64]) -> float: ...
    def det_f(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def assemble_tangent(self, displacement: NDArray[np.float64]) -> None: ...
    def assemble_secant(self, displacement: NDArray[np.float64]) -> None: ...
    def add_pressure_tangent(
        self,
        displaced_points: NDArray[np.float64],
        facets: NDArray[np.int32],
        pressure: float,
    ) -> None: ...
    def add_diagonal_blocks(
        self, points: NDArray[np.int32], blocks: NDArray[np.float64]
    ) -> None: ...
    def absolute_row_sums(self) -> NDArray[np.float64]: ...
    def multiply(self, x: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def build_multigrid(self, is_free: NDArray[np.uint8]) -> int: ...
    def apply_multigrid(self, b: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def solve(
        self,
        b: NDArray[np.float64],
        is_free: NDArray[np.uint8],
        absolute_tolerance: float,
        max_iterations: int,
        uses_multigrid: bool,
    ) -> tuple[NDArray[np.float64], SolveStatus, int]: ...

class BisectedMesh:
    def __init__(
        self,
        points: NDArray[np.float64],
        cells: NDArray[np.int32],
        facet_tags: NDArray[np.int32],
    ) -> None: ...
    def refine(self, marked: NDArray[np.uint8]) -> None: ...
    def leaves(
        self,
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]: ...
    def points(self) -> NDArray[np.float64]: ...
    def point_parents(self) -> NDArray[np.int32]: ...
    def move_point(self, point: int, place: list[float]) -> None: ...

class VerticesInCells:
    def __init__(
        self,
        cell_points: NDArray[np.float64],
        cells: NDArray[np.int32],
        vertices: NDArray[np.int32],
        is_same_body: bool,
        num_threads: int,
        at_most: InstructionSet,
    ) -> None: ...
    def find(
        self, vertex_points: NDArray[np.float64], cell_points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float64]]: ...
    def work(self) -> tuple[int, int, int]: ...
    def voxel_sizes(self) -> list[float]: ...

def find_vertices_in_cells_brute_force(
    vertex_points: NDArray[np.float64],
    vertices: NDArray[np.int32],
    cell_points: NDArray[np.float64],
    cells: NDArray[np.int32],
    is_same_body: bool,
) -> tuple[NDArray[np.int32], NDArray[np.float64]]: ...

class VerticesNearFacets:
    def __init__(
        self,
        facet_points: NDArray[np.float64],
        facets: NDArray[np.int32],
        vertices: NDArray[np.int32],
        is_same_body: bool,
        num_threads: int,
        at_most: InstructionSet,
    ) -> None: ...
    def find(
        self,
        vertex_points: NDArray[np.float64],
        facet_points: NDArray[np.float64],
        distance: float,
    ) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]: ...
    def find_candidates(
        self,
        vertex_points: NDArray[np.float64],
        facet_points: NDArray[np.float64],
        distance: float,
    ) -> NDArray[np.int32]: ...
    def voxel_sizes(self) -> list[float]: ...

def find_vertices_near_facets_brute_force(
    vertex_points: NDArray[np.float64],
    vertices: NDArray[np.int32],
    facet_points: NDArray[np.float64],
    facets: NDArray[np.int32],
    distance: float,
    is_same_body: bool,
    only_candidates: bool,
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]: ...

class EdgesNearEdges:
    def __init__(
        self,
        first_points: NDArray[np.float64],
        first: NDArray[np.int32],
        second_points: NDArray[np.float64],
        second: NDArray[np.int32],
        is_same_body: bool,
        num_threads: int,
        at_most: InstructionSet,
    ) -> None: ...
    def find(
        self,
        first_points: NDArray[np.float64],
        second_points: NDArray[np.float64],
        distance: float,
    ) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]: ...
    def find_candidates(
        self,
        first_points: NDArray[np.float64],
        second_points: NDArray[np.float64],
        distance: float,
    ) -> NDArray[np.int32]: ...

def find_edges_near_edges_brute_force(
    first_points: NDArray[np.float64],
    first: NDArray[np.int32],
    second_points: NDArray[np.float64],
    second: NDArray[np.int32],
    distance: float,
    is_same_body: bool,
    only_candidates: bool,
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]: ...

class CellName:
    @property
    def generation(self) -> int: ...
    @property
    def corner(self) -> list[int]: ...
    @property
    def axis(self) -> list[int]: ...
    def corners(self) -> list[list[int]]: ...
    def children(self) -> list[CellName]: ...
    def parent(self) -> CellName: ...
    def neighbour(self, k: int) -> CellName: ...
    def is_inside(self) -> bool: ...
    def code(self) -> int: ...

class SymbolicCube:
    def __init__(self) -> None: ...
    def refine(self, marked: NDArray[np.uint8]) -> bool: ...
    def cells(self) -> list[CellName]: ...
    def num_cells(self) -> int: ...
    def corners(self) -> NDArray[np.int32]: ...

class SurfaceDistance:
    def __init__(self, points: NDArray[np.float64], facets: NDArray[np.int32]) -> None: ...
    def closest(
        self, places: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]: ...

class Lattice(Enum):
    cubic = 0
    body_centred = 1

def orient3d(a: list[float], b: list[float], c: list[float], d: list[float]) -> int: ...
def in_sphere(
    a: list[float], b: list[float], c: list[float], d: list[float], e: list[float]
) -> int: ...
def delaunay(points: NDArray[np.float64]) -> tuple[NDArray[np.int32], list[int], bool]: ...
def find_delaunay_fault(
    points: NDArray[np.float64], cells: NDArray[np.int32]
) -> tuple[int, int, int]: ...
def rate_star(
    points: NDArray[np.float64],
    facets: NDArray[np.int32],
    place: list[float],
    altitude: float,
) -> tuple[list[float], float]: ...
def find_self_intersections(
    points: NDArray[np.float64], facets: NDArray[np.int32], most: int
) -> NDArray[np.int32]: ...
class SizeGrid:
    @overload
    def __init__(self, edge_length: float) -> None: ...
    @overload
    def __init__(
        self,
        low: Sequence[float],
        edge: float,
        count: Sequence[int],
        leaves: NDArray[np.int32],
        sizes: NDArray[np.float64],
    ) -> None: ...
    def at(self, places: NDArray[np.float64]) -> NDArray[np.float64]: ...

class RemeshedSurface:
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def facets(self) -> NDArray[np.int32]: ...
    distance: float
    splits: int
    collapses: int
    flips: int
    moves: int

def remesh_surface(
    points: NDArray[np.float64],
    facets: NDArray[np.int32],
    sizes: SizeGrid,
    distance: float,
    passes: int,
) -> RemeshedSurface: ...

class SurfaceMesh:
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def cells(self) -> NDArray[np.int32]: ...
    missing_edges: list[list[int]]
    missing_facets: list[int]
    equal_points: list[int]
    recovered_edges: int
    recovered_facets: int
    sliver_flips: int
    sliver_moves: int
    sliver_insertions: int
    steiner_points: int
    boundary_steiner_points: int

def mesh_surface(
    points: NDArray[np.float64],
    facets: NDArray[np.int32],
    lattice: Lattice,
    edge_length: float,
    jitter: float,
    clearance: float,
    seed: int,
    sliver_target: float,
    sliver_passes: int,
    sizes: SizeGrid,
) -> SurfaceMesh: ...

class InstructionSet(Enum):
    baseline = 0
    avx2 = 1
    avx512 = 2

class StopReason(Enum):
    none = 0
    inverted_cell = 1
    out_of_bounds = 2
    energy_growth = 3
    deep_in_tool = 4

def widest_instruction_set() -> InstructionSet: ...

class ToolShape:
    @staticmethod
    def sphere(radius: float) -> ToolShape: ...
    @staticmethod
    def capsule(radius: float, half_length: float) -> ToolShape: ...
    @staticmethod
    def box(x: float, y: float, z: float) -> ToolShape: ...
    @staticmethod
    def half_space() -> ToolShape: ...
    @staticmethod
    def surface(points: NDArray[np.float64], facets: NDArray[np.int32]) -> ToolShape: ...
    def gaps(
        self, places: NDArray[np.float64], pose: NDArray[np.float64]
    ) -> tuple[
        NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]
    ]: ...

class ToolPath:
    def __init__(
        self,
        times: NDArray[np.float64],
        positions: NDArray[np.float64],
        rotations: NDArray[np.float64],
    ) -> None: ...
    def rotation_at(self, time: float) -> list[float]: ...
    def poses_at(self, times: NDArray[np.float64]) -> NDArray[np.float64]: ...

class CentralDifference:
    def __init__(self, time_step: float, mass_damping: float) -> None: ...
    time_step: float
    mass_damping: float
    def next_increments(
        self,
        increment: NDArray[np.float64],
        mass: NDArray[np.float64],
        force: NDArray[np.float64],
    ) -> NDArray[np.float64]: ...

class ExplicitRun:
    @staticmethod
    def make(
        points: NDArray[np.float64],
        cells: NDArray[np.int32],
        lumped_mass: NDArray[np.float64],
        is_free: NDArray[np.uint8],
        *,
        lmbda: float,
        mu: float,
        strain: StrainMeasure,
        time_step: float,
        mass_damping: float,
        displacement_limit: float,
        num_threads: int,
        at_most: InstructionSet,
        is_single: bool,
        tracks_energy: bool,
    ) -> ExplicitRun: ...
    @property
    def instruction_set(self) -> str: ...
    def set_state(
        self,
        displacement: NDArray[np.float64],
        increment: NDArray[np.float64],
        energy: float,
    ) -> None: ...
    def get_state(
        self, displacement: NDArray[np.float64], increment: NDArray[np.float64]
    ) -> None: ...
    def set_dead_load(self, history: int, forces: NDArray[np.float64]) -> None: ...
    def set_pressure(
        self,
        points: NDArray[np.float64],
        facets: NDArray[np.int32],
        pressures: NDArray[np.float64],
        histories: NDArray[np.int32],
    ) -> None: ...
    def set_moving_supports(
        self, values: NDArray[np.float64], histories: NDArray[np.int32]
    ) -> None: ...
    def set_mass_damping(self, mass_damping: float) -> None: ...
    def add_tool(
        self,
        shape: ToolShape,
        *,
        is_constraint: bool,
        friction: float,
        reach: float,
        deepest: float,
        direction: tuple[float, float, float],
        mass: float,
        points: NDArray[np.float64],
        vertices: NDArray[np.int32],
        stiffnesses: NDArray[np.float64],
    ) -> None: ...
    def set_self_contact(
        self,
        points: NDArray[np.float64],
        cells: NDArray[np.int32],
        vertices: NDArray[np.int32],
        facets: NDArray[np.int32],
        parts: NDArray[np.int32],
        stiffnesses: NDArray[np.float64],
        at_most: InstructionSet,
    ) -> None: ...
    def advance(
        self, factors: NDArray[np.float64], tools: NDArray[np.float64]
    ) -> tuple[int, StopReason, int]: ...
    def look(
        self, factors: NDArray[np.float64], tools: NDArray[np.float64]
    ) -> tuple[int, StopReason, int]: ...
    def energies(self) -> tuple[float, float, float]: ...
    def take_tool_records(self) -> NDArray[np.float64]: ...
    def get_contact_force(self, force: NDArray[np.float64]) -> None: ...
    def self_overlap(self) -> tuple[int, float]: ...
    def internal_force(self, force: NDArray[np.float64]) -> None: ...
