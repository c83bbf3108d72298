"""Prints a report as PDF, by a Chromium that is installed on the machine."""

from __future__ import annotations

import html
import os
import re
import shutil
import subprocess
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.supervised import run_supervised
from palpate.meshes.temporaries import atomic_path, scratch_folder

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_TIME_LIMIT = 180.0
# Territories whose paper is US letter; A4 is that of all others (CLDR, paper sizes).
_LETTER = ("BZ", "CA", "CL", "CO", "CR", "GT", "MX", "NI", "PA", "PH", "PR", "SV", "US", "VE")


def paper_size() -> str:
    """The paper of the locale, "A4" or "letter", by LC_ALL, LC_PAPER or LANG, the first given."""
    given = (os.environ.get(name) for name in ("LC_ALL", "LC_PAPER", "LANG"))
    territory = next(filter(None, given), "").partition(".")[0].partition("_")[2][:2]
    return "letter" if territory.upper() in _LETTER else "A4"


def find_browser() -> str | None:
    """Path of a Chromium, or None; PALPATE_BROWSER names one that is not among the usual."""
    chosen = os.environ.get("PALPATE_BROWSER")
    names = (chosen,) if chosen else _BROWSERS
    return next((path for path in map(shutil.which, names) if path), None)


def require_browser() -> str:
    """Path of a Chromium; raises InputError where none was found."""
    browser = find_browser()
    if browser is None:
        raise InputError(
            "a PDF needs Chromium: install it (Debian: apt install chromium), name it in "
            "PALPATE_BROWSER, or open the page and print it"
        )
    return browser


def _footer(text: str) -> str:
    """The title of a page at the foot of each sheet, as a rule of CSS."""
    found = re.search(r"<title>(.*?)</title>", text, re.DOTALL)
    title = html.unescape(found[1]) if found else ""
    # Anybody may have written it: of punctuation only escapes stand in the rule.
    words = re.sub(r"[^\w ]", lambda sign: f"\\{ord(sign[0]):x} ", title)
    return f'@bottom-left {{ content: "{words}"; font: 7.5pt sans-serif; color: #5c6670; }}'


def print_pdf(page: Path) -> Path:
    """Print a page as PDF beside it, whole or not at all; raises InputError where that failed."""
    browser = require_browser()
    target = page.with_suffix(".pdf")
    with scratch_folder("pdf") as scratch:
        made, sized = scratch / "page.pdf", scratch / "page.html"
        text = page.read_text(encoding="utf-8")
        style = f"<style>@page {{ size: {paper_size()}; {_footer(text)} }}</style></head>"
        text = text.replace("</head>", style, 1)
        sized.write_text(text, encoding="utf-8")
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--no-pdf-header-footer",
            "--generate-pdf-document-outline",
            # Chromium refuses to start as root with its sandbox; the page is ours.
            *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),
            f"--user-data-dir={scratch}/profile",
            f"--print-to-pdf={made}",
            sized.as_uri(),
        ]
        try:
            done = run_supervised(command, time_limit=_TIME_LIMIT)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{browser} could not print the report: {error}") from error
        if done.returncode != 0 or not made.is_file():
            last = done.stderr.strip().splitlines()[-1:]
            raise InputError(f"{browser} could not print the report: {' '.join(last) or 'no PDF'}")
        with atomic_path(target) as temporary:
            shutil.copyfile(made, temporary)
    return target
