"""The local server of the live page, with one address with a token, one page and one socket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import secrets
import signal
import socket
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from palpate.meshes.errors import InputError
from palpate.meshes.problem import Element
from palpate.meshes.rigid_tool import rotation_matrix
from palpate.validation.case import Case
from palpate.validation.live import protocol
from palpate.validation.live.live_case import Touch
from palpate.validation.live.simulation import Simulation
from palpate.validation.report.html import (
    page_environment,
    policy_hash,
    script_of,
    template_text,
)
from palpate.validation.report.loads_and_tools import tool_surface
from palpate.validation.report.viewer import colour_table, drawn_inclusions, packed

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

_SCRIPTS = ("drawing.js", "touch.js")
_STYLE = "touch.css"


def page_text(case: Case, simulation: Simulation) -> str:
    """The page of a case; every text in it is escaped."""
    script, _ = script_of(*_SCRIPTS)
    return (
        page_environment()
        .get_template("touch.html.j2")
        .render(
            case=case,
            panes=[pane.name for pane in simulation.panes],
            loads=len(case.spec.load),
            inclusions=len(simulation.inclusions),
            scene=Markup(_scene(simulation)),
            style=Markup(template_text(_STYLE)),
            script=script,
        )
    )


def page_policy(socket: str) -> str:
    """The Content-Security-Policy: it admits our own script, style and socket, nothing else."""
    _, script = script_of(*_SCRIPTS)
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src '{script}'",
            f"style-src '{policy_hash(template_text(_STYLE))}'",
            f"connect-src {socket}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


def _scene(simulation: Simulation) -> str:
    """The body at rest and the tool [mm], as JSON that is safe inside a <script> element."""
    problem, surface = simulation.live.problem, simulation.surface
    drawn = np.concatenate([surface.used, surface.inner])
    points = problem.mesh.points[drawn] * 1e3
    marks = np.zeros(problem.mesh.num_points, dtype=np.int8)
    for support in problem.supports:
        marks[support.points] = 1
    tool = problem.tools[0]
    size = float(np.ptp(problem.mesh.points, axis=0).max())
    own, facets = tool_surface(tool, size, fineness=0.2)
    turned = own @ rotation_matrix(tool.path.rotations[0]).T
    scene: dict[str, Any] = {
        "points": packed(points, np.float32),
        "facets": packed(surface.facets, np.uint32),
        "marks": packed(marks[drawn], np.int8),
        "inclusions": drawn_inclusions(simulation.inclusions),
        "radius": 0.5 * float(np.linalg.norm(np.ptp(points, axis=0))),
        "axis": int(np.argmin(np.ptp(points, axis=0))),
        "colours": colour_table(),
        "tool": {
            "points": packed(turned * 1e3, np.float32),
            "facets": packed(facets, np.uint32),
        },
    }
    return json.dumps(scene, allow_nan=False).replace("<", "\\u003c")


HOST = "127.0.0.1"
# The most frames on their way to the page; a later frame replaces one that waits.
_ON_THE_WAY = 3
# The most orders that wait; further ones are dropped.
_WAITING = 1000
# The time that the page has to close its socket when the server ends [s].
_LEAVE = 1.0
# Close code of a page whose socket another page uses.
IN_USE = 4009


def ignore_broken_pipes() -> None:
    """Make a page that leaves an error of its socket, as Python does at its start.

    PETSc and gmsh, once used in the process, let it end the process. This does nothing outside the
    main thread, which alone can change it.
    """
    if threading.current_thread() is threading.main_thread() and hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)


class TouchUnavailableError(InputError):
    """The library of the server, `websockets`, is not installed."""


def _without_interrupts(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report what went wrong in a task; an interrupt that came there ends the program anyway."""
    if not isinstance(context.get("exception"), KeyboardInterrupt):
        loop.default_exception_handler(context)


class PageServer:
    """Serves the page of one case.

    Args:
        case: The case that is touched.
        touch: How it is touched.
        elements: The elements of the panes.
        folder: Where recordings and judged poses go.
        patience: Time without a page after which the server ends [s]; a page that returns earlier
            finds its body as it was. Default: it waits until Ctrl-C.
        port: The port to listen at; 0 takes a free one.

    Attributes:
        address: The address of the page, with its token.

    Raises:
        TouchUnavailableError: `websockets` is not installed.
        InputError: The case cannot be touched, or the port is in use.
    """

    def __init__(
        self,
        case: Case,
        touch: Touch,
        elements: tuple[Element, ...],
        *,
        folder: Path,
        patience: float = math.inf,
        port: int = 0,
    ) -> None:
        try:
            import websockets  # noqa: F401
        except ImportError:
            raise TouchUnavailableError(
                'palpate touch needs websockets; pip install "palpate[touch]"'
            ) from None
        self.simulation = Simulation(
            case, touch, elements, folder=folder, wants_frame=self._wants_frame, send=self._take
        )
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as error:
            raise InputError(f"port {port}: {error.strerror}; leave --port out") from error
        self._port = self._socket.getsockname()[1]
        self._token = secrets.token_urlsafe(24)
        self._origin = f"http://{HOST}:{self._port}"
        self.address = f"{self._origin}/{self._token}/"
        self._page = page_text(case, self.simulation).encode()
        self._patience, self._is_stopping = patience, False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._connection: ServerConnection | None = None
        self._notes: deque[str] = deque()
        self._slot: tuple[int, bytes] | None = None
        # The frame that the simulation has made and the loop has not sent yet.
        self._is_coming = False
        self._sent = self._shown = 0

    def serve(self, ready: Callable[[str], None]) -> None:
        """Serve until Ctrl-C, or until the page has been gone for longer than `patience`.

        Args:
            ready: Called with the address as soon as pages can connect.
        """
        try:
            asyncio.run(self._serve(ready))
        finally:
            self._loop = None
            self.simulation.end()

    @property
    def page_size(self) -> int:
        """Size of the page [bytes]."""
        return len(self._page)

    def stop(self) -> None:
        """End `serve`; this is called from another thread."""
        self._is_stopping = True
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # closed meanwhile
                self._loop.call_soon_threadsafe(self._gone.set)

    async def _serve(self, ready: Callable[[str], None]) -> None:
        from websockets.asyncio.server import ServerConnection, serve

        transports: weakref.WeakSet[asyncio.Transport] = weakref.WeakSet()

        class Connection(ServerConnection):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                transports.add(self.transport)

        def abort() -> None:
            for transport in list(transports):
                transport.abort()

        ignore_broken_pipes()
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(_without_interrupts)
        self._news, self._gone = asyncio.Event(), asyncio.Event()
        server = await serve(
            self._attend,
            create_connection=Connection,
            sock=self._socket,
            origins=[self._origin],  # type: ignore[list-item]
            process_request=self._respond,
            max_size=protocol.MOST_BYTES,
            compression=None,
            server_header=None,
        )
        try:
            self.simulation.start()
            ready(self.address)
            while not self._is_stopping:
                await self._gone.wait()
                if not self._is_stopping and await self._stays_away():
                    return
        finally:
            server.close()
            # Browsers open sockets in advance; the server would wait ten seconds for a request.
            self._loop.call_later(_LEAVE, abort)
            await server.wait_closed()

    async def _stays_away(self) -> bool:
        """Whether the page is still away when the time of `patience` is over."""
        while self._gone.is_set() and not self._is_stopping:
            self._gone.clear()
            with contextlib.suppress(asyncio.TimeoutError):
                # It is set again: the page came back and left once more, so the wait starts over.
                await asyncio.wait_for(
                    self._gone.wait(), None if math.isinf(self._patience) else self._patience
                )
        return self._connection is None

    # ---------------------------------------------------------------- requests

    def _respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page or a refusal; None lets the socket open."""
        if request.headers.get_all("Host") != [f"{HOST}:{self._port}"]:
            return connection.respond(HTTPStatus.FORBIDDEN, "another host\n")
        _, token, *rest = [*request.path.split("/"), ""]
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return connection.respond(HTTPStatus.FORBIDDEN, "wrong or missing token\n")
        if rest == ["socket", ""]:
            if request.headers.get_all("Origin") != [self._origin]:
                return connection.respond(HTTPStatus.FORBIDDEN, "another origin\n")
            return None
        if rest != ["", ""]:
            return connection.respond(HTTPStatus.NOT_FOUND, "there is only the page\n")
        from websockets.datastructures import Headers
        from websockets.http11 import Response

        headers = Headers(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Length": str(len(self._page)),
                "Content-Security-Policy": page_policy(f"ws://{HOST}:{self._port}"),
                "Cache-Control": "no-store",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
                "Cross-Origin-Resource-Policy": "same-origin",
                "Connection": "close",
            }
        )
        return Response(HTTPStatus.OK, "OK", headers, self._page)

    # ---------------------------------------------------------------- the socket

    async def _attend(self, connection: ServerConnection) -> None:
        if self._connection is not None:
            await connection.close(IN_USE, "another window touches this body")
            return
        self._connection = connection
        self._notes.clear()
        self._slot = None
        self._shown = self._sent
        self._notes.append(json.dumps(self.simulation.scene(), allow_nan=False))
        self._news.set()
        sending = asyncio.create_task(self._send(connection))
        self.simulation.seen(True)
        try:
            await self._listen(connection)
        finally:
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sending
            self._connection = None
            self.simulation.seen(False)
            self._gone.set()

    async def _listen(self, connection: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            async for text in connection:
                received = time.perf_counter()
                try:
                    message = protocol.read_message(text)
                except protocol.MessageError as error:
                    self._say({"kind": "refused", "text": str(error)})
                    continue
                if isinstance(message, protocol.Shown):
                    self._shown = max(self._shown, min(message.frame, self._sent))
                    self._news.set()
                elif self.simulation.waiting() < _WAITING:
                    self.simulation.order(message, received)

    async def _send(self, connection: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            while True:
                await self._news.wait()
                self._news.clear()
                while self._notes:
                    await connection.send(self._notes.popleft())
                if self._slot is not None and self._sent - self._shown < _ON_THE_WAY:
                    (self._sent, frame), self._slot = self._slot, None
                    await connection.send(frame)

    def _wants_frame(self) -> bool:
        return self._connection is not None and self._slot is None and not self._is_coming

    def _take(self, news: tuple[int, bytes] | dict[str, Any]) -> None:
        """Take a frame or a note for the page from the simulation's thread."""
        loop = self._loop
        if loop is not None:
            self._is_coming |= isinstance(news, tuple)
            with contextlib.suppress(RuntimeError):  # closed meanwhile
                loop.call_soon_threadsafe(self._put, news)

    def _put(self, news: tuple[int, bytes] | dict[str, Any]) -> None:
        if isinstance(news, tuple):
            self._is_coming = False
        if self._connection is None:
            return
        if isinstance(news, tuple):
            self._slot = news
            self._news.set()
        else:
            self._say(news)

    def _say(self, note: dict[str, Any]) -> None:
        if len(self._notes) < _WAITING:
            self._notes.append(json.dumps(note, allow_nan=False))
            self._news.set()
