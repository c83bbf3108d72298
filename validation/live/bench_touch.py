"""`palpate bench touch`: times the live page's server with a recording client, without a browser.

A tool is pressed into the kidney of `steps` and drawn aside; linear and Green strain run beside
each other in a thread each. Rows have seconds (wall clock, for a second of simulated time) with
rate, its reciprocal; processor_factor, the simulated time over the processor time of the busier
thread, which does not depend on what else the machine does; frames_per_second; latency_ms and
worst_latency_ms from a message of the pointer to the frame that shows it, by the server's clock;
megabytes_per_second; page_kilobytes. The client stands in for a page, in timings and in tests.
"""

from __future__ import annotations

import json
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.fastsim.mesher import mesh_surface
from palpate.meshes.arrays import Points
from palpate.meshes.files import write_mesh
from palpate.meshes.kidney import shape_kidney
from palpate.meshes.problem import Element, Strain
from palpate.meshes.tet_mesh import TetMesh
from palpate.validation.live.frames import unpack_frame
from palpate.validation.states import Progress
from palpate.validation.versions import version_of

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

# Waiting longer than this for a frame is an error [s].
_PATIENCE = 30.0


class Client:
    """The page's end of the socket.

    Attributes:
        scene: The first message of the server.
        frames: The heads of all frames received.
        sizes: The sizes of these frames [bytes].
        notes: All notes received.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.frames: list[dict[str, Any]] = []
        self.sizes: list[int] = []
        self.notes: list[dict[str, Any]] = []
        self.scene = self._note(socket.recv(_PATIENCE))
        self._last = b""

    def say(self, kind: str, **message: Any) -> None:
        """Send a message as the page does."""
        self.socket.send(json.dumps({"kind": kind, **message}))

    def hear(self) -> dict[str, Any]:
        """Return the head of the next frame, and confirm that frame; or return the next note."""
        news = self.socket.recv(_PATIENCE)
        if isinstance(news, str):
            self.notes.append(self._note(news))
            return self.notes[-1]
        length = int.from_bytes(news[:4], "little")
        head: dict[str, Any] = json.loads(news[4 : 4 + length])
        self.say("shown", frame=head["frame"])
        self._last = news
        self.frames.append(head)
        self.sizes.append(len(news))
        return head

    def until(self, is_so: Callable[[dict[str, Any]], bool], most: int = 10_000) -> dict[str, Any]:
        """The first head or note for which `is_so` is true.

        Raises:
            TimeoutError: It is true for none of the first `most`, or nothing is received.
        """
        for _ in range(most):
            heard = self.hear()
            if is_so(heard):
                return heard
        raise TimeoutError(f"none of {most} frames and notes")

    def until_time(self, seconds: float) -> dict[str, Any]:
        """The first frame at this simulated time [s] or later."""
        return self.until(lambda heard: heard.get("time", -1.0) >= seconds)

    def positions(self, num_points: int) -> list[Points]:
        """Positions of surface points in the last frame [mm], (num_points, 3) for each pane."""
        _, numbers, _ = unpack_frame(self._last, num_points)
        box = self.scene["box"]
        return [box["step"] * of + np.array(box["origin"]) for of in numbers]

    @staticmethod
    def _note(text: str | bytes) -> dict[str, Any]:
        note: dict[str, Any] = json.loads(text)
        return note


@contextmanager
def connected(address: str, **changed: Any) -> Iterator[Client]:
    """A client connected to a page; `changed` goes to `websockets.sync.client.connect`."""
    from websockets.sync.client import connect

    options = {"origin": address.rsplit("/", 2)[0], "max_size": None, "compression": None}
    with connect(address.replace("http", "ws", 1) + "socket", **(options | changed)) as socket:
        yield Client(socket)


# The number of cells of the kidney of `palpate bench steps`.
KIDNEY = 20_000
# Simulated time [s]; the first part is not counted.
SECONDS, WARM_UP = 6.0, 1.0
# How far the tool is pressed in and drawn aside [mm].
_WAY = ((0.0, 0.0, -22.0), (6.0, 4.0, -24.0))
_CASE = """
schema = 1
title = "Kidney under a tool"

[units]
length = "mm"
stress = "kPa"

[geometry]
mesh = "kidney.vtu"

[material]
youngs_modulus = 10.0
poissons_ratio = 0.45
density = 1000.0

[[support]]
region = { half_space = { point = [0.0, 0.0, -26.75], normal = [0.0, 0.0, -1.0] } }
"""


def measure(_size: int, progress: Progress) -> list[dict[str, Any]]:
    """Time the server, as one row.

    Raises:
        TouchUnavailableError: `websockets` is not installed.
    """
    progress(f"meshing a kidney of about {KIDNEY} cells")
    with tempfile.TemporaryDirectory(prefix="palpate-touch-") as name:
        mesh = mesh_surface(shape_kidney(edge_length=5.15e-3))
        return [measured(mesh, Path(name), progress)]


def measured(
    mesh: TetMesh, folder: Path, progress: Progress, seconds: float = SECONDS
) -> dict[str, Any]:
    """Serve a body of soft tissue [m] to a client that moves the tool, and read the clocks.

    Args:
        mesh: A body of a kidney's size; it is fixed below and pressed from above.
        folder: Where the case is written.
        progress: Called once.
        seconds: Simulated time [s].
    """
    from palpate.validation.case import load_case
    from palpate.validation.live.live_case import Touch
    from palpate.validation.live.server import PageServer

    write_mesh(folder / "kidney.vtu", TetMesh(mesh.points * 1e3, mesh.cells))
    (folder / "kidney.toml").write_text(_CASE, encoding="utf-8")
    server = PageServer(
        load_case(folder / "kidney.toml"), Touch(), (Element.LINEAR,), folder=folder
    )
    ready = threading.Event()
    serving = threading.Thread(target=server.serve, args=(lambda _: ready.set(),))
    serving.start()
    try:
        ready.wait()
        progress(f"a tool on {mesh.num_cells} cells for {seconds:g} s")
        with connected(server.address) as client:
            start = np.array(client.scene["tool"]["start"])
            for number in range(1, 10**6):
                now = client.until(lambda heard: "panes" in heard)["time"]
                if now > seconds:
                    break
                part = 2.0 * now / seconds
                way = np.array(_WAY)
                goal = min(part, 1.0) * way[0] + max(part - 1.0, 0.0) * (way[1] - way[0])
                client.say("tool", number=number, to=(start + goal).tolist())
                if now < WARM_UP:
                    begin, first, sent = time.perf_counter(), len(client.frames), len(client.sizes)
            spent = time.perf_counter() - begin
            heads = client.frames[first:]
            bytes_sent = sum(client.sizes[sent:])
    finally:
        server.stop()
        serving.join()
    latencies = [1e3 * head["latency"] for head in heads if head["latency"] is not None]
    touching = heads[len(heads) // 2 :]
    rate = float(np.median([head["factor"] for head in touching]))
    return {
        "tool": "palpate",
        "version": version_of("palpate"),
        "size": mesh.num_cells,
        "threads": len(Strain),
        "precision": "float64",
        "seconds": 1.0 / rate,
        "rate": rate,
        "rate_unit": "seconds of the bodies' time per second",
        "processor_factor": float(np.median([head["cpu_factor"] for head in touching])),
        "frames_per_second": len(heads) / spent,
        "latency_ms": float(np.median(latencies)),
        "worst_latency_ms": max(latencies),
        "megabytes_per_second": bytes_sent / spent / 1e6,
        "page_kilobytes": server.page_size / 1e3,
        "real_time_held": (heads[-1]["time"] - heads[0]["time"]) / spent,
        "force": float(np.linalg.norm(heads[-1]["panes"][1]["force"])),
        "trouble": any(pane["trouble"] for pane in heads[-1]["panes"]),
    }


BENCHMARK = SimpleNamespace(
    sizes=(KIDNEY,),
    measure=measure,
    summary=lambda _rows: [],  # the table says everything
    table=("processor_factor", "frames_per_second", "latency_ms", "worst_latency_ms",
           "megabytes_per_second", "page_kilobytes", "real_time_held"),
)  # fmt: skip
