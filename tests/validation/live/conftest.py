"""A server in the test's own process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from palpate.meshes.problem import Element
from palpate.validation.case import load_case
from palpate.validation.live.live_case import Touch
from palpate.validation.live.server import PageServer

Serving = Callable[..., AbstractContextManager[PageServer]]


@pytest.fixture
def serving(tmp_path: Path) -> Serving:
    @contextmanager
    def serve(
        case: str | Path,
        touch: Touch | None = None,
        elements: tuple[Element, ...] = (Element.LINEAR,),
        **options: Any,
    ) -> Iterator[PageServer]:
        server = PageServer(load_case(case), touch or Touch(), elements, folder=tmp_path, **options)
        ready = threading.Event()
        thread = threading.Thread(target=server.serve, args=(lambda _: ready.set(),), daemon=True)
        thread.start()
        assert ready.wait(30)
        try:
            yield server
        finally:
            server.stop()
            thread.join(10)
            assert not thread.is_alive()

    return serve
