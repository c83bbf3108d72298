"""What adapters share: solving a case folder, timing a tool, and common computations.

python ADAPTER.py CASE RESULT.npz [NAME=VALUE ...]      see `solve_case`
python harness.py ADAPTER.py TASK JOB.npz RESULT.npz    see `main`

Simulators that only make time steps find equilibrium by kinetic damping: the body moves towards
equilibrium, and is stopped whenever its kinetic energy has passed a peak (Cundall 1976; Otter 1965
for dynamic relaxation). Time is not physical then, so the step is chosen for stability alone.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

# Exit code of a program to which a case cannot be posed; that is no failure.
NOT_POSED = 77
_LAWS = {"linear": "linear elasticity", "green": "Saint-Venant-Kirchhoff"}
_COMMON = "saint-venant-kirchhoff"
# A factor on stable steps for a stiffness that grows: Green strain stiffens under stretch.
SAFETY = 0.6
# Steps to rest in which supports and tools are moved to their positions.
RISE = 2000
# An output is a step where it is as near to it, relative to its time.
SAME_STEP = 1e-9


def solve_case(statics: Any, motion: Any = None) -> None:
    """Solve the case folder given first on the command line into the file given second.

    Further words go to the job: NAME=VALUE, or a number alone, which is `iterations`.

    Args:
        statics: The class `Static` of an adapter, None where it has none. It has `tool`, a name for
            people, and may have `law`, if that is not the case's; `laws`, those for finite
            strain that it takes from a case, if there are others than Saint-Venant-Kirchhoff;
            `takes`, names of what it takes and others refuse; and `shapes`, kinds of the tools
            that it takes: its job has `tools` as case.json describes them, if there are any.
        motion: The class `Motion`, for motions, None where it has none. Its job also has
            `output_times` [s] and the case's `time_step`, `mass_damping` and `stiffness_damping`.
    """
    case, result = (Path(word).absolute() for word in sys.argv[1:3])
    given = json.loads((case / "case.json").read_text(encoding="utf-8"))
    kinds = [load["kind"] for load in given["loads"]]
    job = {**read_arrays(case / "rest.npz"), "strain": given["strain"], "load_kinds": kinds}
    for word in sys.argv[3:]:
        name, _, value = word.rpartition("=")
        job[name or "iterations"] = value
    span = given["time"]
    adapter = motion if span else statics
    is_stepped = span and motion is not None
    changes = any(one["amplitude"] for one in (*given["loads"], *given["supports"]))
    if is_stepped:
        changes = changes or bool(job["prescribed_displacement"].any())
        job |= {"output_times": np.array(span["output_times"]), "time_step": span["time_step"]}
        job |= {key: span[key] for key in ("mass_damping", "stiffness_damping")}
    has = {
        "time": span and motion is None,
        "statics": not span and statics is None,
        "loads or supports that change in time": is_stepped and changes,
        "stiffness damping": is_stepped and span["stiffness_damping"] > 0.0,
        "tools": given["tools"] and not getattr(adapter, "shapes", ()),
        "springs": given["springs"],
        "masses in motion": span and given["masses"],
        "follower pressure": len(job["pressure"]),
        "inclusions": given["has_inclusions"],
        "slanted supports": "sliding_normals" in job,
    }
    left = [name for name in has if has[name] and name not in getattr(adapter, "takes", ())]
    if left:
        refuse(f"{', '.join(left)}: not handed to this simulator here")
    if given["tools"]:
        job["tools"] = _known_tools(given["tools"], adapter)
    job["law"] = given["material"].get("law", _COMMON) if given["strain"] == "green" else _COMMON
    known = getattr(adapter, "laws", (_COMMON,))
    if job["law"] not in known:
        refuse(f"law {job['law']}: not posed to {adapter.tool} here, only {', '.join(known)}")
    os.chdir(result.parent)  # some write a log into the working folder
    try:
        simulator = adapter(job)
    except (ImportError, ValueError) as error:
        refuse(str(error))
    start = processor_seconds()
    says = simulator.advance(1)
    about = {
        "peak_memory_mb": max(peak_memory_mb(), children_memory_mb()),
        "tool": simulator.tool,
        "version": simulator.version,
        "law": getattr(simulator, "law", _LAWS[given["strain"]])
        if job["law"] == _COMMON
        else job["law"],
        "seconds": processor_seconds() - start,
        **says,
    }
    np.savez(result, **simulator.result, case_key=given["case_key"], about=json.dumps(about))


def _known_tools(tools: list[dict[str, Any]], adapter: Any) -> list[dict[str, Any]]:
    """The tools, where the adapter knows each of them; else the case is refused."""
    for number, tool in enumerate(tools, start=1):
        kind = tool["shape"]["kind"]
        why = {
            f"shape {kind}, only {', '.join(adapter.shapes)}": kind not in adapter.shapes,
            "friction": tool["friction_coefficient"] > 0.0,
            "a drive in the place of a path": tool["drive"] is not None,
        }
        if left := [name for name in why if why[name]]:
            refuse(f"tool {number}: {'; '.join(left)}: not handed to {adapter.tool} here")
    return tools


def place_of(tool: dict[str, Any], time: float) -> Any:
    """Position of a tool's origin at a time of its path [m], (3,)."""
    times, positions = np.array(tool["path"]["times"]), np.array(tool["path"]["positions"])
    return np.array([np.interp(time, times, column) for column in positions.T])


def main() -> None:
    """Time a tool until standard input ends.

    It writes one line of JSON when the tool is set up, then one for each number of steps it reads:
    processor time and wall time [s], memory, and what the tool reports.
    """
    # What libraries print must not mix with these lines.
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def say(**words: Any) -> None:
        out.write(json.dumps(words) + "\n")
        out.flush()

    adapter, task, job, target = sys.argv[1:]
    sys.path.insert(0, str(Path(adapter).parent))
    try:
        tool = getattr(importlib.import_module(Path(adapter).stem), task)(read_arrays(job))
    except ImportError as error:
        say(missing=str(error))
        return
    except ValueError as error:
        say(unfit=str(error))
        return
    say(version=str(tool.version), precision=tool.precision)
    saved: dict[str, Any] | None = None
    for line in sys.stdin:
        before = processor_seconds(), time.perf_counter()
        says = tool.advance(int(line)) or {}
        after = processor_seconds(), time.perf_counter()
        found = getattr(tool, "result", {})
        if found is not saved:
            np.savez(target, **found)
            saved = found
        say(
            processor=after[0] - before[0],
            wall=after[1] - before[1],
            **{"peak_memory_mb": peak_memory_mb(), **says},
        )


def read_arrays(path: str | Path) -> dict[str, Any]:
    """All arrays of an .npz file."""
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}


def refuse(why: str) -> NoReturn:
    """End because the case cannot be posed to this simulator; some libraries still print."""
    print(why, flush=True)
    os._exit(NOT_POSED)


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, without what it inherited at its start."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        return next(float(x.split()[1]) for x in lines if x.startswith("VmHWM")) / 1024.0
    except (OSError, StopIteration):
        return _peak_of("RUSAGE_SELF")


def children_memory_mb() -> float:
    """Largest peak memory of a process started here; 0 where the system does not report it."""
    return _peak_of("RUSAGE_CHILDREN")


def _peak_of(whose: str) -> float:
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    return resource.getrusage(getattr(resource, whose)).ru_maxrss / 1024.0


def processor_seconds() -> float:
    """Processor time of this process, all threads, and of ended child processes [s]."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def lame(job: dict[str, Any]) -> tuple[float, float]:
    """Lamé's parameters lmbda and mu of a body of one material [Pa]."""
    E, nu = float(job["youngs_modulus"][0]), float(job["poissons_ratio"][0])
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def all_gradients(job: dict[str, Any]) -> tuple[Any, Any]:
    """Gradients of the four shape functions [1/m], (num_cells, 4, 3), and volumes [m3]."""
    points, cells = job["points"], job["cells"]
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    inner = np.linalg.inv(edges).transpose(0, 2, 1)
    gradients = np.concatenate([-inner.sum(axis=1)[:, None], inner], axis=1)
    return gradients, np.linalg.det(edges) / 6.0


def load_parts(job: dict[str, Any], count: int = 4) -> list[float]:
    """Fractions of the load, which Newton's method does not bear at once where strain is finite."""
    parts = 1 if str(job["strain"]) == "linear" else int(job.get("load_parts", count))
    return [(k + 1) / parts for k in range(parts)]


def require_fixed_points(job: dict[str, Any]) -> None:
    """Raise ValueError where a job fixes components, or moves them: some fix whole points alone."""
    is_fixed = job["fixed"].astype(bool)
    if (is_fixed.any(axis=1) != is_fixed.all(axis=1)).any() or job["prescribed_displacement"].any():
        raise ValueError("only whole points can be fixed, where they are")


def force_scale(job: dict[str, Any]) -> float:
    """The scale of a residual [N]: the load, or about what a moved support or a tool needs."""
    load = float(np.linalg.norm(np.where(job["fixed"], 0.0, job["external_force"])))
    moved = float(np.abs(job["prescribed_displacement"]).max())
    ways = [np.ptp(tool["path"]["positions"], axis=0).max() for tool in job.get("tools", ())]
    moved = max(moved, *ways) if ways else moved
    size = float(np.ptp(job["points"], axis=0).max())
    return load or float(job["youngs_modulus"][0]) * moved * size


def central_differences(job: dict[str, Any]) -> tuple[float, Any]:
    """Factors of increment <- keep increment + mobility (external - internal force)."""
    dt = float(job["time_step"])
    half = 0.5 * float(job["mass_damping"]) * dt
    mobility = dt**2 / (job["lumped_mass"][:, None] * (1.0 + half))
    return (1.0 - half) / (1.0 + half), np.where(job["fixed"], 0.0, mobility)


def gravity_of(job: dict[str, Any]) -> Any:
    """The acceleration whose weight is the load [m/s2], for tools that take no other load."""
    return job["external_force"].sum(axis=0) / job["lumped_mass"].sum()


def stable_step(job: dict[str, Any], mass: Any) -> float:
    """A time step below 2 / sqrt(largest eigenvalue of M^-1 K), times SAFETY [s].

    A cell's matrix is bounded by V (lmbda + 2 mu) sum |grad N_a|^2, and each point sums the bounds
    of the cells around it (Gershgorin); mass [kg], (num_points,).
    """
    E, nu = job["youngs_modulus"], job["poissons_ratio"]
    modulus = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    gradients, volume = all_gradients(job)
    sizes = np.sqrt((gradients**2).sum(axis=2))
    rows = (volume * modulus)[:, None] * sizes * sizes.sum(axis=1)[:, None]
    largest = (np.bincount(job["cells"].ravel(), rows.ravel(), len(mass)) / mass).max()
    return float(SAFETY * 2.0 / np.sqrt(largest))


def relax(
    step: Callable[[], None], velocity: Callable[[], Any], inertia: Any, force: float,
    tolerance: float, most: int, out_of_balance: Callable[[], Any] | None = None,
) -> tuple[int, float]:  # fmt: skip
    """Step to rest; returns the number of steps and the last relative residual.

    Args:
        step: Takes one step, by semi-implicit Euler unless `out_of_balance` is given.
        velocity: The array of velocities, which may be written to [m/s].
        inertia: Mass over time step for each entry of `velocity` [kg/s].
        force: Scale of the residual [N].
        tolerance: Tolerance of the relative residual.
        most: Largest number of steps.
        out_of_balance: Returns the present residual forces [N]. Without it they are read from the
            change of velocity, which is equivalent for explicit steps alone: implicit steps that
            are not solved to the end hardly change it, even far from equilibrium.
    """
    energy, before, residual = 0.0, velocity().copy(), np.inf
    for count in range(1, most + 1):
        step()
        now = velocity()
        unbalanced = inertia * (now - before) if out_of_balance is None else out_of_balance()
        residual = float(np.linalg.norm(unbalanced) / force)
        last, energy = energy, float((inertia * now**2).sum())
        if not np.isfinite(energy):
            raise SystemExit(f"the motion blew up after {count} steps")
        if residual <= tolerance:
            return count, residual
        if energy < last:
            now[:] = 0.0
            energy = 0.0
        before = now.copy()
    return most, residual


class Stepped(ABC):
    """A tool that only makes time steps: it is stepped to rest, or from output to output.

    Attributes:
        tolerance: Relative residual that is stepped to.
        enough: The largest one that is accepted after `most_steps`.
        most_steps: Largest number of steps to rest.
        integrator: Name of its scheme, for motions.
        remark: Ends the description of the method.
        about: Further columns of the result.
        out_of_balance: Returns the residual forces [N]; see `relax`.
        time_step: Length of a step [s].
        inertia: Mass over time step for each entry of the velocity [kg/s].
    """

    job: dict[str, Any]
    tolerance, enough, most_steps = 1e-7, 1e-6, 200_000
    integrator, remark = "semi-implicit-euler", ""
    about: Mapping[str, Any] = MappingProxyType({})
    out_of_balance: Callable[[], Any] | None = None
    time_step: float
    inertia: Any

    @abstractmethod
    def step(self, part: float = 1.0) -> None:
        """Take a step, with supports and tools at this fraction of their displacement."""

    @abstractmethod
    def velocity(self) -> Any:
        """The array of velocities, which may be written to [m/s]."""

    @abstractmethod
    def displacement(self) -> Any:
        """Displacement of the points [m], (num_points, 3), a new array."""

    def advance(self, _num_steps: int) -> dict[str, Any]:
        """From the start to rest, or to the end of the motion."""
        says = self._move() if "output_times" in self.job else self._come_to_rest()
        return {**says, "time_step": self.time_step, **self.about}

    def _come_to_rest(self) -> dict[str, Any]:
        is_moved = self.job["prescribed_displacement"].any() or "tools" in self.job
        rise = RISE if is_moved else 0
        fractions = iter(np.linspace(0.0, 1.0, rise))

        def relaxed(tolerance: float, most: int) -> tuple[int, float]:
            return relax(
                lambda: self.step(next(fractions, 1.0)), self.velocity, self.inertia,
                force_scale(self.job), tolerance, most, self.out_of_balance,
            )  # fmt: skip

        relaxed(-1.0, rise)
        count, residual = relaxed(self.tolerance, self.most_steps)
        require_rest(residual, self.enough)
        self.result = {"displacement": self.displacement()}
        method = f"time steps to rest by kinetic damping, {count} steps{self.remark}"
        return {"method": method, "relative_residual": residual}

    def _move(self) -> dict[str, Any]:
        """To the first step at or behind the end, by its own steps cut in `substeps`.

        The states of `steps_to_send` are sent: it neither shortens its step so that it divides the
        outputs nor reads between its steps by itself, which is left to the judge.
        """
        self.time_step = self.time_step / int(self.job.get("substeps", 1))
        sent = steps_to_send(self.job["output_times"], self.time_step)
        states = {0: self.displacement()}
        for number in range(1, max(sent) + 1):
            self.step()
            if number in sent:
                states[number] = self.displacement()
                if not np.isfinite(states[number]).all():
                    raise SystemExit(f"the motion blew up by {sent[number]:.4g} s")
        self.result = {
            "displacement": np.array([states[number] for number in sent]),
            "times": np.array(list(sent.values())),
        }
        return {"method": f"its own steps{self.remark}", "integrator": self.integrator}


def steps_to_send(output_times: Any, time_step: float) -> dict[int, float]:
    """Which steps of a motion are sent, and their times [s], in their order.

    Of an output that is a step, that step; of any other the two steps before it and the two behind,
    from which the judge reads it by a cubic (at either end of the motion, the four nearest). The
    last is the first step at or behind the end.
    """
    steps = np.asarray(output_times) / time_step
    is_step = np.abs(steps - np.round(steps)) <= SAME_STEP * np.maximum(steps, 1.0)
    last = int(np.where(is_step, np.round(steps), np.ceil(steps))[-1])
    sent = {int(np.round(at)) for at in steps[is_step]} | {0, last}
    for at in steps[~is_step]:
        first = min(max(int(at) - 1, 0), max(last - 3, 0))
        sent.update(range(first, min(first + 4, last + 1)))
    return {number: number * time_step for number in sorted(sent)}


def require_rest(residual: float, tolerance: float) -> None:
    """End without a result where the last relative residual is above the tolerance."""
    if not residual <= tolerance:
        raise SystemExit(
            f"not at rest at its last step: {residual:.2g} of the load out of balance, which is "
            f"above {tolerance:g}"
        )


if __name__ == "__main__":
    main()
