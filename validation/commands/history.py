"""`palpate history`: how far off released versions of a simulator are, and since when."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.console import Console

from palpate.meshes.errors import InputError
from palpate.validation.commands.options import Folder, OptionalCases, progress_lines

# Versions that are judged where none are named: the newest so many.
_NEWEST = 12
_CASES = ("stretch", "shear")


def history(
    simulator: Annotated[str, typer.Argument(help="package, such as mujoco, or name of a row")],
    output: Folder,
    names: OptionalCases = None,
    versions: Annotated[
        str, typer.Option(help="FIRST:LAST, both included, such as 3.3:4.0; default: newest 12")
    ] = "",
    bisect: Annotated[
        bool, typer.Option("--bisect", help="install only what finds where it changed")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="download without a question")] = False,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE for the adapter, such as turned=60")
    ] = None,
    disk: Annotated[
        float, typer.Option(help="GB (1e9 bytes) that new environments may take together")
    ] = 5.0,
    time_limit: Annotated[float, typer.Option(help="of one run, in seconds")] = 120.0,
) -> None:
    """Judge released versions of a simulator, and find where its error changed.

    Each version is installed by pip from its package index, wheels only, into an environment of its
    own in ~/.cache/palpate/released (or $XDG_CACHE_HOME), and judged on small cases under its own
    law by the registry's adapter; stretch and shear where none are named. One that cannot be
    installed or does not fit the adapter is skipped with a word. The page has the error over the
    version, what explains it before and after a change, and the settings. The exit code is 1 where
    a version is off or an error has changed.
    """
    from palpate.validation.case import load_cases
    from palpate.validation.output_files import input_files
    from palpate.validation.peers.history import (
        beside,
        of_its_law,
        page_of,
        peer_of,
        trace,
        with_options,
    )
    from palpate.validation.peers.released import in_range, is_cached, released_versions
    from palpate.validation.report.study_page import leave
    from palpate.validation.run_folder import require_run_folder, run_folder

    for name, value in (("--disk", disk), ("--time-limit", time_limit)):
        if not 0.0 < value < float("inf"):
            raise InputError(f"{name} {value:g}: needs a finite value above 0")
    peer, package = peer_of(simulator)
    peer = with_options(peer, option or ())
    cases = of_its_law(peer, load_cases(names or _CASES))
    inputs = input_files(cases)
    require_run_folder(output, inputs=inputs)
    known = released_versions(package)
    asked = in_range(known, versions or ":")
    asked = asked if versions else asked[-_NEWEST:]
    new = [version for version in asked if not is_cached(package, version, beside(peer, version))]
    if new:
        most = "at most " if bisect else ""
        with_others = f", each with {', '.join(peer.packages[1:])}" if peer.packages[1:] else ""
        said = f"{most}{len(new)} version(s) of {package}: {', '.join(new)}{with_others}"
        said += f", wheels only, {disk:g} GB together at most"
        if not yes and not (sys.stdin.isatty() and typer.confirm(f"Download {said}?")):
            raise InputError(f"nothing was downloaded; --yes downloads {said}")
        progress_lines()(f"downloading {said}")
    found = trace(
        peer,
        package,
        asked,
        cases,
        gigabytes=disk,
        bisects=bisect,
        time_limit=time_limit,
        progress=progress_lines(),
    )
    findings, page = page_of(found)
    about = [
        f"{peer.title}: {package} {asked[0]} to {asked[-1]}, {peer.homepage}. The error is the "
        "largest distance from the reference on the same mesh, over its largest displacement.",
        "A change may be one of the adapter or of a package beside it: confirm a finding by "
        "`palpate law` or `palpate gate --metamorphic` before it is reported.",
    ]
    with run_folder(output, inputs=inputs) as fresh:
        code = leave(
            fresh,
            Console(highlight=False),
            name="history",
            title=f"History of {package}",
            about=about,
            findings=findings,
            page=page,
        )
    print(f"{output / 'report.html'}")
    raise typer.Exit(code)
