"""Steps all bodies in real time under the same pointer, and never waits for the page."""

from __future__ import annotations

import dataclasses
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from palpate.meshes.arrays import Floats
from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element, Strain
from palpate.validation.case import Case
from palpate.validation.live import protocol
from palpate.validation.live.frames import FrameMaker, Pace
from palpate.validation.live.judging import Judging, not_judged
from palpate.validation.live.live_case import Touch, live_case, patch_radius
from palpate.validation.live.panes import BetweenVertices, ExplicitPane, Surface, make_panes
from palpate.validation.live.pointer import RETREAT, Pointer, Settling
from palpate.validation.live.recording import (
    MOST_GRIPS,
    Grip,
    free_name,
    make_grip,
    write_pose,
    write_recording,
)
from palpate.validation.report.loads_and_tools import inclusions_inside

FRAME = 1.0 / 60.0
# The most that all frames together may take [bytes/s].
MOST_RATE = 2.8e6
# The tool takes at least this time to cross the body, however fast the pointer moves [s].
_SIDES_PER_SECOND = 1.0
# Fraction of the speed that vertices can follow, also where the tool retreats.
_SPEED_SAFETY = 0.8 / RETREAT
# Simulated time that is late by more than this does not catch up [s].
_LOST = 0.1
_LONGEST_RECORDING = 30.0

# The resolution to which positions are written [m].
NANOMETRE = 1e-9

Note = dict[str, Any]
# What is done at first where a pose is judged.
SETTLING = "waiting until the bodies rest"


class Simulation(threading.Thread):
    """Steps in real time in a thread of its own, with another thread for each further pane.

    Args:
        case: The case that is touched.
        touch: How it is touched.
        elements: The elements of the panes.
        folder: Where recordings go.
        wants_frame: Whether the page can take one more frame.
        send: Takes a frame with its number, or a note, for the page; returns at once.
    """

    def __init__(
        self,
        case: Case,
        touch: Touch,
        elements: tuple[Element, ...],
        *,
        folder: Path,
        wants_frame: Callable[[], bool],
        send: Callable[[tuple[int, bytes] | Note], None],
    ) -> None:
        super().__init__(name="simulation", daemon=True)
        self._case, self._touch, self._elements = case, touch, elements
        self._folder, self._wants_frame, self._send = folder, wants_frame, send
        self._orders: queue.SimpleQueue[tuple[protocol.Message | None, float]]
        self._orders = queue.SimpleQueue()
        self._is_paused = self._is_seen = False
        self._ending = threading.Event()
        self._recorded: list[Floats] | None = None
        self._judging: Judging | None = None
        self.recorded_grips: list[Grip] = []
        self._shown_order = (0, 0.0)
        self._new_order: tuple[int, float] | None = None
        mesh = case.mesh.mesh
        rest = mesh.points[np.unique(mesh.boundary_facets)] * 1e3
        self._frames = FrameMaker(rest, case.problem.material.youngs_modulus)
        self._build()
        self._pool = ThreadPoolExecutor(max(1, len(self.panes) - 1), thread_name_prefix="pane")

    def order(self, message: protocol.Message, received: float) -> None:
        """Take a message of the page, received at a time of `time.perf_counter`."""
        self._orders.put((message, received))

    def waiting(self) -> int:
        """Number of orders that are not executed yet."""
        return self._orders.qsize()

    def seen(self, is_seen: bool) -> None:
        """Note whether there is a page: without one simulated time stands still."""
        self._is_seen = is_seen
        self._orders.put((None, 0.0))

    def end(self) -> None:
        """Stop the thread, and wait until it has ended."""
        self._ending.set()
        self._orders.put((None, 0.0))
        if self.is_alive():
            self.join()
        self._pool.shutdown()
        if self._judging is not None:
            self._judging.stop()

    def scene(self) -> Note:
        """What the page needs before the first frame; lengths are in mm."""
        live, milli = self.live, self._milli
        return {
            "kind": "scene",
            "box": self._frames.box.described(),
            "tool": {**live.data["tool"][0], "start": (live.start * milli).tolist()},
            "patch": self._patch * 1e3,
            "panes": [pane.name for pane in self.panes],
            "speed": self._largest_speed * 1e3,
            **live.described(),
            "loads": len(self._case.spec.load),
            "has_loads": self._touch.has_loads,
        }

    def _build(self) -> None:
        live = live_case(self._case, self._touch, self._elements)
        used = np.unique(live.problem.mesh.boundary_facets)
        inner, self.inclusions = inclusions_inside(
            live.problem, used, self._case.spec.units, live.data
        )
        surface = Surface(live.problem, inner)
        self.panes = make_panes(
            live.problem, surface, self._elements, is_condensed=self._touch.is_condensed
        )
        self.live, self.surface, problem = live, surface, live.problem
        self._milli = self.live.unit * 1e3
        side = float(np.ptp(problem.mesh.points, axis=0).max())
        allowed = _SPEED_SAFETY * min(pane.largest_speed for pane in self.panes)
        self._patch = patch_radius(problem.mesh)
        self._largest_speed = min(allowed, _SIDES_PER_SECOND * side)
        self._reset()

    def _reset(self) -> None:
        tick = self.live.clock.tick
        unit = self.live.unit
        self.pointer = Pointer(
            self.live.start,
            self.live.outwards,
            self._largest_speed * tick / unit,
            digits=round(np.log10(unit / NANOMETRE)),
        )
        for pane in self.panes:
            pane.reset()
        self._ticks = 0
        self._grip: Grip | None = None
        self._grips: list[Grip] = []
        self._pace = Pace(tick)
        self._frames.begin()
        self._reported: set[int] = set()
        self._settling: Settling | None = None
        self._due = time.perf_counter()

    def run(self) -> None:
        """Run the thread: orders, a tick, a frame, a pause, and again."""
        next_frame = 0.0
        while not self._ending.is_set():
            changed = self._take_orders(wait=self._is_still())
            if self._ending.is_set():
                break
            if self._settling is not None and self._settling.is_over:
                settled, self._settling = self._settling, None
                self._judge(settled)
                changed = True
            if self._is_still():
                self._due = time.perf_counter()
                if changed and self._is_seen:
                    self._show()
                continue
            self._tick()
            now = time.perf_counter()
            if now >= next_frame and self._wants_frame():
                size = self._show()
                next_frame = max(next_frame, now - FRAME) + max(FRAME, size / MOST_RATE)
            self._due = max(self._due + self.live.clock.tick, now - _LOST)
            if self._due > now:
                time.sleep(self._due - now)

    def _is_still(self) -> bool:
        return self._is_paused or not self._is_seen

    def _take_orders(self, *, wait: bool) -> bool:
        """Execute orders; wait for one if `wait`. Return whether there were any."""
        changed = False
        try:
            while True:
                message, received = self._orders.get(block=wait and not changed)
                changed = True
                if message is not None:
                    self._obey(message, received)
        except queue.Empty:
            return changed

    def _tick(self) -> None:
        clock = self.live.clock
        room = min(pane.room for pane in self.panes)
        position = self.pointer.next_position(room)
        metres = self.live.metres(position)
        begin = time.perf_counter()
        anchor = self._next_anchor(room)
        others = [
            self._pool.submit(pane.advance, metres, anchor, clock.steps) for pane in self.panes[1:]
        ]
        self.panes[0].advance(metres, anchor, clock.steps)
        for other in others:
            other.result()
        for number, pane in enumerate(self.panes):
            if pane.trouble and number not in self._reported:
                self._reported.add(number)
                self._say(f"{pane.name}: {pane.trouble}")
        spent = time.perf_counter() - begin
        self._pace.note(spent, max(pane.cpu_seconds for pane in self.panes))
        self._ticks += 1
        if self._settling is not None:
            self._settle(self._settling)
        if self._new_order is not None:
            self._shown_order, self._new_order = self._new_order, None
        if self._recorded is not None:
            self._recorded.append(position.copy())
            if len(self._recorded) * clock.tick > _LONGEST_RECORDING:
                self._end_recording()

    def _next_anchor(self, room: float) -> Floats | None:
        """The next displacement of the grip's anchor [m]; None where nothing is grabbed."""
        if self._grip is None:
            return None
        position = self._grip.pointer.next_position(room)
        self._grip.positions.append(position.copy())
        return self.live.metres(position)

    def _show(self) -> int:
        """Send a frame, and return its size [bytes]."""
        now = time.perf_counter()
        number, received = self._shown_order
        grip = self._grip
        head = {
            "time": self._ticks * self.live.clock.tick,
            "tool": (self.pointer.position * self._milli).tolist(),
            "grip": None if grip is None else (grip.pointer.position * self._milli).tolist(),
            "held_back": self.pointer.is_held_back
            or (grip is not None and grip.pointer.is_held_back),
            "paused": self._is_paused,
            "recording": self._recorded is not None,
            "answered": number,
            "latency": now - received if received else None,
            **self._pace.described(),
        }
        self._shown_order = (number, 0.0)
        frame = self._frames.frame(self.panes, head)
        self._send((self._frames.count, frame))
        return len(frame)

    def _say(self, text: str, **more: Any) -> None:
        self._send({"kind": "note", "text": text, **more})

    def _obey(self, message: protocol.Message, received: float) -> None:
        match message:
            case (
                protocol.ToolTo()
                | protocol.Grab()
                | protocol.Pull()
                | protocol.Order(kind="withdraw")
            ) if self._settling is not None:
                pass  # the tool stays where it is
            case protocol.ToolTo(number=number, to=to):
                self.pointer.send(np.array(to) / self._milli)
                self._new_order = (number, received)
            case protocol.Grab(point=point, radius=radius):
                self._grab(point, radius)
            case protocol.Pull(number=number, by=by) if self._grip is not None:
                self._grip.pointer.send(self._grip.first + np.array(by) / self._milli)
                self._new_order = (number, received)
            case protocol.Order(kind="let_go"):
                self._let_go()
            case protocol.Order(kind="withdraw"):
                self._let_go()
                self.pointer.withdraw()
            case protocol.Order(kind="reset"):
                self._recorded = None
                if self._judging is not None:  # which had paused the bodies
                    self._judging.stop()
                    self._judging, self._is_paused = None, False
                self._reset()
            case protocol.Order(kind="judge"):
                self._begin_to_judge()
            case protocol.Switch(kind="pause", on=on):
                self._is_paused = on
            case protocol.Switch(kind="loads", on=on):
                self._recorded = None
                self._with_loads(on)
            case protocol.Switch(kind="record", on=True):
                self._reset()
                self._recorded = [self.pointer.position.copy()]
            case protocol.Switch(kind="record", on=False):
                self._end_recording()
            case protocol.ColourBy(by=by):
                self._frames.colour_by(by)

    def _grab(self, point: int, radius: float) -> None:
        self._let_go()
        if self._recorded is not None and len(self._grips) >= MOST_GRIPS:
            self._say(f"a recording takes {MOST_GRIPS} grips; end it first")
            return
        used = self.surface.used
        green = next(
            p for p in self.panes if isinstance(p, ExplicitPane) and p.strain is Strain.GREEN
        )
        try:
            grip = make_grip(
                self.live,
                green,
                int(used[min(point, len(used) - 1)]),
                radius * 1e-3,
                largest_way=self.pointer.largest_way,
                digits=self.pointer.digits,
            )
        except InputError as error:
            self._say(str(error))
            return
        for pane in self.panes:
            pane.attach(grip.spring)
        self._grip = grip
        self._grips.append(grip)
        spring = grip.spring
        self._say(
            f"grabbed: a spring of {spring.stiffness:.3g} N/m over a patch of "
            f"{1e3 * spring.radius:.3g} mm"
        )

    def _let_go(self) -> None:
        if self._grip is None:
            return
        self._grip.end = self._ticks * self.live.clock.steps
        for pane in self.panes:
            pane.release()
        self._grip = None

    def _begin_to_judge(self) -> None:
        if self._judging is not None and self._judging.is_alive():
            self._say("the pose before is still being judged")
            return
        self._recorded, self._is_paused = None, False
        self.pointer.stay()
        if self._grip is not None:
            self._grip.pointer.stay()
        self._settling = Settling(self.live.clock.tick)
        self._send({"kind": "progress", "text": SETTLING, "share": 0.0})

    def _settle(self, settling: Settling) -> None:
        """Watch the bodies settle; forces are means over the last window or less."""
        if settling.note([pane.displacement for pane in self.panes]) and not settling.is_over:
            self._send({"kind": "progress", "text": SETTLING, "share": settling.share})
            for pane in self.panes:
                pane.mean_force()

    def _judge(self, settled: Settling) -> None:
        """Judge the pose, once the bodies rest or the waiting time is over."""
        self._is_paused = True
        forces = [pane.mean_force() for pane in self.panes]
        try:
            name = free_name(self._folder, f"held-{self._case.name}")
            spring = None if self._grip is None else self._grip.static_table()
            case, pose = write_pose(
                self.live,
                self.pointer.position,
                self.panes,
                forces,
                spring,
                self._folder,
                name,
                settled.each_to_go,
            )
        except (InputError, OSError) as error:
            self._is_paused = False
            self._send(not_judged(str(error)))
            return
        self._say(settled.says)
        moved = [pane.displacement for pane in self.panes]
        metres = self.live.metres(self.pointer.position)
        if warning := BetweenVertices(self.live.problem).warning(metres, moved):
            self._say(warning)
        self._judging = Judging(case, pose, self._send)
        self._judging.start()

    def _with_loads(self, on: bool) -> None:
        before = self._touch
        self._touch = dataclasses.replace(before, has_loads=on)
        try:
            self._build()
        except InputError as error:
            self._touch = before
            self._say(str(error))
        self._send(self.scene())

    def _end_recording(self) -> None:
        positions, self._recorded = self._recorded, None
        self.recorded_grips = [grip for grip in self._grips if grip.positions]
        if positions is None:
            return
        try:
            name = free_name(self._folder, f"touched-{self._case.name}")
            path = write_recording(self.live, positions, self._grips, self._folder, name)
        except (InputError, OSError) as error:
            self._say(f"not recorded: {error}")
            return
        seconds = (len(positions) - 1) * self.live.clock.tick
        self._say(f"{seconds:.3g} s recorded: palpate gate {path} --live", recorded=str(path))
