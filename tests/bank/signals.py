"""Commands that get signals, and the processes that are left of them."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

PALPATE = [sys.executable, "-m", "palpate.validation.cli"]


def default_signals() -> None:
    """What a shell ignores for a job in the background is not ignored by what is started here."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def group_members(scratch: Path) -> list[str]:
    """Command lines of living processes whose temporary folder is this one, or is in it."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes()
            environment = (folder / "environ").read_bytes()
        except OSError:
            continue
        if f"\0TMPDIR={scratch}".encode() in b"\0" + environment:
            found.append(words.decode(errors="replace"))
    return found
