"""The front door: what `import palpate` offers, in SI units.

Plain data (a mesh, a material, supports, loads, a problem) comes from `palpate.meshes`; the
functions do what the verbs of the command line do. Nothing slow is loaded before a function that
needs it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from numpy.typing import ArrayLike

from palpate.meshes.amplitude import TabularAmplitude
from palpate.meshes.boundary_conditions import (
    BodyForce,
    PointForce,
    Pressure,
    Support,
    Traction,
    gravity,
    spread_force,
)
from palpate.meshes.errors import InputError
from palpate.meshes.material_law import Law
from palpate.meshes.point_mass import PointMass
from palpate.meshes.problem import Element, Inclusion, Material, Problem, Strain, TimeSpan
from palpate.meshes.repair.choices import RepairChoices
from palpate.meshes.rigid_tool import (
    BoxShape,
    CapsuleShape,
    ContactRule,
    ForceDrive,
    PlaneShape,
    RigidTool,
    SphereShape,
    SurfaceShape,
    ToolPath,
)
from palpate.meshes.shapes import shape_box as box
from palpate.meshes.shapes import shape_cylinder as cylinder
from palpate.meshes.shapes import shape_sphere as sphere
from palpate.meshes.spring import AnchorPath, Spring
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tri_surface import TriSurface
from palpate.reference.errors import ReferenceFailedError, ReferenceUnavailableError
from palpate.reference.result import Formulation
from palpate.validation.solving import (
    ElementName,
    ElementsName,
    Simulator,
    StrainName,
    known_word,
    simulate,
    solve,
)
from palpate.validation.states import (
    CandidateFailedError,
    Elements,
    Method,
    Precision,
    Progress,
    State,
    Trajectory,
    Verdict,
    in_silence,
)

if TYPE_CHECKING:
    from pyvista import UnstructuredGrid

    from palpate.reference.result import Audit
    from palpate.validation.candidates.candidate import Candidate
    from palpate.validation.candidates.equations import AskedSteps
    from palpate.validation.case import Case
    from palpate.validation.judging.results import CaseResult
    from palpate.validation.studies.fit_case import CaseFit

__all__ = [
    "AnchorPath",
    "BodyForce",
    "BoxShape",
    "CandidateFailedError",
    "CapsuleShape",
    "Element",
    "Elements",
    "ForceDrive",
    "Formulation",
    "Inclusion",
    "InputError",
    "Law",
    "Material",
    "Method",
    "PlaneShape",
    "PointForce",
    "PointMass",
    "Pressure",
    "Problem",
    "ReferenceFailedError",
    "ReferenceUnavailableError",
    "RepairChoices",
    "RigidTool",
    "Simulator",
    "SphereShape",
    "Spring",
    "State",
    "Strain",
    "Support",
    "SurfaceShape",
    "TabularAmplitude",
    "TetMesh",
    "TimeSpan",
    "ToolPath",
    "Traction",
    "Trajectory",
    "TriSurface",
    "Verdict",
    "audit",
    "box",
    "compare",
    "cylinder",
    "export",
    "fit",
    "gravity",
    "judge",
    "load_case",
    "mesh",
    "simulate",
    "solve",
    "sphere",
    "spread_force",
    "to_pyvista",
]

# A case that was read, the name of a built-in case, or a path to a .toml file.
AnyCase: TypeAlias = "Case | str | Path"


def load_case(name_or_path: str | Path) -> Case:
    """Read a case: a built-in name, or a path to a .toml file.

    Its `problem` is meshed on first access; its `checks` state what is judged.

    Args:
        name_or_path: `palpate cases` lists the built-in ones; `palpate init` writes a file.

    Returns:
        The case, in SI units.

    Raises:
        InputError: The case does not exist or is not TOML, a key is unknown or missing, or a value
            is invalid; the message names file, line, key and remedy.

    >>> import palpate
    >>> case = palpate.load_case("kidney")
    >>> case.strain, case.problem.material.poissons_ratio
    (<Strain.GREEN: 'green'>, 0.2239)
    """
    from palpate.validation.case import load_case as read_case

    return read_case(name_or_path)


def mesh(
    surface: TriSurface | str | Path,
    *,
    unit: Literal["m", "cm", "mm"] = "mm",
    edge_length: float | None = None,
    mesher: Literal["auto", "fastsim", "gmsh"] = "auto",
    boundary_distance: float | None = None,
    repair: bool | RepairChoices = False,
    wrap: float | None = None,
) -> TetMesh:
    """Fill a closed surface with tetrahedra.

    Args:
        surface: A surface [m], or a file of one: .stl, .obj, .ply, .off, .msh, .vtk, .vtu, .vtp.
        unit: The unit of length of a file; a surface that is passed is in metres.
        edge_length: Wanted edge length inside [m], > 0; None takes the surface's mean.
        mesher: fastsim's own, gmsh, or the first and then the other.
        boundary_distance: How far better facets may lie from the given ones [m], > 0; None keeps
            the surface's own.
        repair: Repair a file: merge near points, cut fins, turn facets, close holes (facet groups
            "cap 1", ...) and repair self-intersections; or which of these may be done.
        wrap: How far a new closed surface around a file's facets, repaired or not, may lie from
            them [m], > 0; None makes no such surface.

    Returns:
        The mesh [m]; where the surface is kept, the volume is that of the surface.

    Raises:
        InputError: The file cannot be read, the surface bounds no solid, a value is invalid, or no
            mesher succeeds.

    >>> import palpate
    >>> body = palpate.mesh(palpate.box((0.06, 0.02, 0.02), edge_length=0.01))
    >>> round(body.volume * 1e6, 6)  # cm3
    24.0
    """
    from palpate.validation.case.geometry import LoadedSurface, load_surface
    from palpate.validation.case.meshing import Plan, fill_loaded
    from palpate.validation.conversions import LENGTH

    for name, value in (("edge_length", edge_length), ("boundary_distance", boundary_distance)):
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"{name} = {value:g} m: needs a finite value above 0")
    for name, word, known in (
        ("unit", unit, tuple(LENGTH)),
        ("mesher", mesher, ("auto", "fastsim", "gmsh")),
    ):
        if word not in known:
            raise InputError(f"{name} = {word!r}: use one of {', '.join(known)}")
    if isinstance(surface, TriSurface):
        loaded = LoadedSurface(surface, [], {})
    else:
        choices = RepairChoices() if repair is True else repair or None
        loaded = load_surface(Path(surface), scale=LENGTH[unit], repair=choices, wrap=wrap)
    plan = Plan(mesher=mesher, edge_length=edge_length, boundary_distance=boundary_distance)
    return fill_loaded(loaded, plan).mesh


def judge(
    case: AnyCase,
    simulator: str | Callable[[Problem], ArrayLike] | None = None,
    *,
    element: ElementsName | None = None,
    integrator: str | None = None,
    time_step: float | None = None,
    law: Law | str | None = None,
    precision: str | None = None,
    contact: ContactRule | str | None = None,
    live: bool = False,
    time_limit: float | None = None,
    progress: Progress = in_silence,
) -> CaseResult:
    """Judge a simulator on a case.

    The equations are the case's, except those that are asked for here; what a result states of
    itself chooses none of them, and fails where it differs.

    Args:
        case: A case with at least one check.
        simulator: A function from the problem to displacements [m] at its points, (num_points,
            3), for a motion (num_outputs + 1, num_points, 3); or a command, "mysim {case}
            {result}"; fastsim where None.
        element: The tetrahedra that it is judged by: "linear", "smoothed", or of fastsim "both"
            beside one another; linear where None.
        integrator: The scheme that motions of another simulator are judged by on the same mesh,
            such as "backward-euler"; central differences where None.
        time_step: The time step of that [s], which the simulator is asked for; the case's where
            None.
        law: Law instead of the case's; the reference is solved here.
        precision: "single" or "double", granted to the result; what the case grants where None.
        contact: "vertices" or "facets", of every tool instead of the case's; the reference is
            solved here.
        live: Solve the reference here if FEniCSx is installed; otherwise use the stored one.
        time_limit: Time limit of a command, and of the reference by other steps than the case's
            [s]; 600 where None.
        progress: Called with a line of text from time to time.

    Returns:
        The verdict, and every check with its number, limit and reason. A simulator that raises
        (SystemExit and KeyboardInterrupt, too), crashes or returns NaN has failed.

    Raises:
        InputError: No check for this simulator, no reference, or displacements of a wrong shape or
            kind: complex, masked, truth values, text, objects, with units.
        KeyboardInterrupt: The process was interrupted by a signal. A function that sends itself
            one is taken for the user, and one that calls `os._exit` ends your script: run such a
            simulator as a command.

    >>> import palpate
    >>> def nothing_moves(problem):
    ...     return 0.0 * problem.mesh.points
    >>> palpate.judge("block").verdict, palpate.judge("block", nothing_moves).verdict
    (<Verdict.PASSED: 'passed'>, <Verdict.FAILED: 'failed'>)
    """
    from palpate.validation.candidates.candidate import candidates_for, function_candidate

    chosen = None if element is None else known_word(Elements, element, "element")
    asked = _asked_steps(integrator, time_step, time_limit)
    if simulator is None or isinstance(simulator, str):
        scheme, step = asked.integrator, asked.time_step
        candidates = candidates_for(
            simulator, asked.time_limit, chosen, integrator=scheme, time_step=step
        )
    elif chosen is Elements.BOTH:
        raise InputError('element = "both" is of fastsim: say which one your simulator has')
    else:
        kind = None if chosen is None else Element(chosen)
        candidates = [function_candidate(simulator, kind, asked)]
    return _judged(_case(case), candidates, law, precision, contact, live=live, progress=progress)


def compare(
    case: AnyCase,
    solution: str | Path | State | ArrayLike,
    *,
    element: ElementName | None = None,
    integrator: str | None = None,
    time_step: float | None = None,
    law: Law | str | None = None,
    precision: str | None = None,
    contact: ContactRule | str | None = None,
    live: bool = False,
    time_limit: float | None = None,
    progress: Progress = in_silence,
) -> CaseResult:
    """Judge an existing solution.

    Args:
        case: A case with at least one check.
        solution: A result file (.vtu, .npz, .csv), a state, or displacements [m] in the
            shape that `judge` expects.
        element: The tetrahedra that it is judged by, linear where None, whatever the solution says.
        integrator: See `judge`.
        time_step: See `judge`.
        law: See `judge`.
        precision: See `judge`.
        contact: See `judge`.
        live: See `judge`.
        time_limit: Of the reference by other steps than the case's [s]; 600 where None.
        progress: See `judge`.

    Returns:
        The verdict, as `judge` gives it.

    Raises:
        InputError: See `judge`; or the file cannot be read.

    >>> import palpate
    >>> solution = palpate.solve(palpate.load_case("block").problem)
    >>> palpate.compare("block", solution).verdict
    <Verdict.PASSED: 'passed'>
    >>> palpate.compare("block", 1.02 * solution.displacement).verdict
    <Verdict.FAILED: 'failed'>
    """
    from palpate.validation.candidates.candidate import solution_candidate

    kind = None if element is None else known_word(Element, element, "element")
    asked = _asked_steps(integrator, time_step, time_limit)
    candidates = [solution_candidate(solution, kind, asked)]
    return _judged(_case(case), candidates, law, precision, contact, live=live, progress=progress)


def _asked_steps(
    integrator: str | None, time_step: float | None, time_limit: float | None
) -> AskedSteps:
    """The scheme and step that a caller asks for."""
    from palpate.reference.schemes import read_integrator
    from palpate.validation.candidates.equations import TIME_LIMIT, AskedSteps

    scheme = None if integrator is None else read_integrator(integrator)
    return AskedSteps(scheme, time_step, TIME_LIMIT if time_limit is None else time_limit)


def _judged(
    case: Case,
    candidates: Sequence[Candidate],
    law: str | None,
    precision: str | None,
    contact: str | None,
    *,
    live: bool,
    progress: Progress,
) -> CaseResult:
    """Judge candidates on a case under the law, precision and contact that are asked for."""
    from palpate.validation.judging.case_references import is_to_be_solved
    from palpate.validation.judging.judge import judge_case

    if law is not None:
        case = case.under(known_word(Law, law, "law"))
    if contact is not None:
        case = case.with_contact(known_word(ContactRule, contact, "contact"))
    granted = None if precision is None else known_word(Precision, precision, "precision")
    return judge_case(
        case,
        live=live or is_to_be_solved(case),
        candidate=candidates,
        precision=granted,
        progress=progress,
    )


def audit(
    case: AnyCase,
    solution: str | Path | State | ArrayLike,
    *,
    strain: StrainName | None = None,
    degree: int = 2,
    element: ElementName | None = None,
    progress: Progress = in_silence,
) -> Audit:
    """Measure a solution against the equations it should satisfy, without solving them.

    Args:
        case: A static case.
        solution: See `compare`.
        strain: Strain measure of the equations; the case's where None.
        degree: Of the test functions: 1 judges the solver; 2 and 3 the mesh too, and need FEniCSx.
        element: The tetrahedra whose equations degree 1 tests; linear where None.
        progress: Called with a line of text from time to time.

    Returns:
        Residual, balance of forces and moments, stability, estimated errors, each cell's part.

    Raises:
        InputError: The case is a motion, or the solution cannot be used: it is on another mesh
            than the case's, or states other tetrahedra than degree 1 is asked to test.
        CandidateFailedError: The solution contains NaN.
        ReferenceUnavailableError: Degree 2 or 3, and FEniCSx is not installed.

    >>> import palpate
    >>> solution = palpate.solve(palpate.load_case("block").problem)
    >>> found = palpate.audit("block", solution, degree=1)
    >>> found.relative_residual_norm < 1e-8, found.smallest_det_f > 0.0
    (True, True)
    """
    from palpate.validation.candidates.candidate import solution_candidate

    if degree not in (1, 2, 3):
        raise InputError(f"degree = {degree}: use 1, 2 or 3")
    loaded = _case(case)
    used = loaded.strain if strain is None else known_word(Strain, strain, "strain")
    kind = None if element is None else known_word(Element, element, "element")
    candidate = solution_candidate(solution, kind)
    from palpate.validation.judging.audit import audit_result

    _, found = audit_result(loaded, candidate, strain=used, degree=degree, progress=progress)
    return found


def export(
    case: AnyCase,
    folder: str | Path,
    *,
    strain: StrainName | None = None,
    force: bool = False,
) -> Path:
    """Write a case as a folder that any simulator can read: case.json, rest.vtu, rest.npz.

    Args:
        case: The case to write.
        folder: Created if it does not exist; a folder with anything but an exported case is
            refused.
        strain: The strain measure that is asked for; the case's where None.
        force: Whether files of those names that palpate did not write may be replaced.

    Returns:
        The folder.

    Raises:
        InputError: The folder cannot be used.

    >>> import palpate
    >>> folder = palpate.export("block", "block-case")
    >>> sorted(path.name for path in folder.iterdir())
    ['case.json', 'rest.npz', 'rest.vtu']
    """
    from palpate.validation.exchange.case_folder import write_case_folder
    from palpate.validation.output_files import input_files, require_case_folder

    loaded, target = _case(case), Path(folder)
    require_case_folder(target, inputs=input_files([loaded]), force=force)
    used = loaded.strain if strain is None else known_word(Strain, strain, "strain")
    write_case_folder(target, loaded.problem, used, name=loaded.name, title=loaded.title)
    return target


def fit(
    case: AnyCase,
    parameters: Sequence[str],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    data: Sequence[str] | None = None,
    hold_out: Sequence[str] = (),
    last_step: Literal["reference", "mesh", "none"] | None = None,
    progress: Progress = in_silence,
) -> CaseFit:
    """Fit numbers of a case to its measurements, and predict those that are held out.

    Args:
        case: A case with [[measurement]], its name or file.
        parameters: Keys of the numbers, such as "material.youngs_modulus".
        bounds: What is thought possible, by key, in the case's units; see `palpate fit --help`.
        data: Measurements to fit to; None takes the case's that are not held out.
        hold_out: Measurements that are predicted and judged.
        last_step: By the reference, a finer mesh or neither; None takes the first that is there.
        progress: Called with one line now and then.

    Returns:
        `values` by key; `fit` with intervals and what the data cannot tell; `held_out`.

    Raises:
        InputError: What cannot be used, or a fit that cannot be made.

    >>> import palpate
    >>> bar = palpate.fit("silicone-bar", ["material.youngs_modulus"], last_step="none")
    >>> round(bar.values["material.youngs_modulus"], -4), bar.fit.undetermined
    (260000.0, ())
    """
    from palpate.validation.studies.fit_case import LastStep, fit_case, parameters_of

    loaded = _case(case)
    step = None if last_step is None else known_word(LastStep, last_step, "last_step")
    given = parameters_of(loaded, parameters, bounds)
    return fit_case(loaded, given, data=data, hold_out=hold_out, last_step=step, progress=progress)


def _case(case: AnyCase) -> Case:
    return load_case(case) if isinstance(case, str | Path) else case


def to_pyvista(problem: Problem, state: State, *, step: int = -1) -> UnstructuredGrid:
    """The deformed body as an `UnstructuredGrid` of pyvista, with what was computed as its data.

    `grid.plot(scalars="displacement")` shows it, and every filter of pyvista works on it. Points
    are deformed, x = X + u.

    Args:
        problem: The problem that was solved.
        state: Its solution.
        step: Number of the output time of a motion; the last one by default.

    Returns:
        Points [m]; point data `displacement` [m]; for the last state also cell data `von_mises` and
        `cauchy_stress` [Pa] (nine components, row by row), where the state has stresses.

    Raises:
        InputError: pyvista is not installed; or there is no such output time; or the state is on
            another mesh.

    >>> import importlib.util
    >>> import palpate
    >>> problem = palpate.load_case("block").problem
    >>> if importlib.util.find_spec("pyvista"):
    ...     grid = palpate.to_pyvista(problem, palpate.solve(problem))
    ...     assert grid.n_cells == problem.mesh.num_cells
    """
    from palpate.validation.report.pyvista_grid import to_pyvista as make_grid

    return make_grid(problem, state, step=step)
