"""`palpate touch CASE`: a body on a local page, seen and touched in real time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.validation.commands.words import (
    ChosenElements,
    OneCase,
    is_condensed,
    progress_lines,
)
from palpate.validation.solving import Simulator


def touch(
    case: OneCase,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="folder for recordings and what is judged")
    ] = Path("out/touch"),
    element: ChosenElements = None,
    engine: Annotated[
        Simulator,
        typer.Option("--with", help="condensed: its condensed linear model in a pane besides"),
    ] = Simulator.FASTSIM,
    loads: Annotated[bool, typer.Option(help="begin with the case's own loads")] = False,
    tool: Annotated[
        str | None, typer.Option(help="sphere, capsule, or a closed surface beside the case")
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help="of the sphere or the capsule, in the case's unit")
    ] = None,
    damping: Annotated[
        float | None, typer.Option(help="mass damping [1/s]; default: the case's")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: a free one")] = 0,
    browser: Annotated[bool, typer.Option(help="open the page")] = True,
    wait: Annotated[
        float,
        typer.Option(min=0, help="for a page that was closed [s], then end; inf: until Ctrl-C"),
    ] = 60.0,
) -> None:
    """Show a body on a local page and touch it: linear beside Green strain, in real time.

    The page is for this machine and one window: it has a token in its address, and a second one is
    refused. Without a page the bodies stand still. All ends a while after the page was closed, or
    by Ctrl-C. Needs the extra `touch`.
    """
    import math
    import webbrowser

    from palpate.validation.case import load_case
    from palpate.validation.live.live_case import Touch, tool_table
    from palpate.validation.live.panes import condensed_words
    from palpate.validation.live.server import PageServer
    from palpate.validation.states import Elements

    loaded = load_case(case)
    progress_lines()(f"reading and meshing {loaded.name}")
    hand = Touch(tool_table(loaded, tool, radius), loads, damping, is_condensed(engine))
    elements = (Elements.LINEAR if element is None else element).each
    if hand.is_condensed:
        progress_lines()(condensed_words(loaded.problem, elements[0]))
    server = PageServer(loaded, hand, elements, folder=output, patience=wait, port=port)

    ends = "Ctrl-C ends it."
    if math.isfinite(wait):
        ends = f"It ends {wait:g} s after the page was closed, or by Ctrl-C."

    def ready(address: str) -> None:
        print(f"touch {loaded.name} at {address}", flush=True)
        print(ends, flush=True)
        if browser:
            webbrowser.open(address)

    server.serve(ready)
