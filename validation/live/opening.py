"""Opens the live page in a browser, whose command line any user of the machine may read (`ps`)."""

from __future__ import annotations

import contextlib
import html
import os
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import locked, own_mark

_PAGE = """<!doctype html><meta charset="utf-8"><title>palpate touch</title>
<meta name="referrer" content="no-referrer"><meta http-equiv="refresh" content="0; url={0}">
<a href="{0}">the body</a>
"""


@contextmanager
def opened(address: str, folder: Path) -> Iterator[None]:
    """Open the address in a browser by a file that this user alone can read; it goes at the end.

    The address has the token of the page, and the browser's command line only the file's name. The
    file stands in the folder of the recordings: a browser in a sandbox of its own (snap, flatpak)
    sees the user's folders, and no temporary ones.

    Args:
        address: The page's address with its token.
        folder: The folder of the recordings, which is made where it does not exist.

    Raises:
        InputError: The folder cannot be written.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    page = folder.absolute() / f".page.palpate-{own_mark()}.tmp.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(page, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder}: cannot be written ({reason}); name another by -o") from error
    try:
        with locked(page):
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(_PAGE.format(html.escape(address)))
            webbrowser.open(page.as_uri())
            yield
    finally:
        page.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # something was recorded
            for path in made:
                path.rmdir()
