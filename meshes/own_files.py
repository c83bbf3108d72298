"""Files that palpate wrote, known by a mark in them: these alone it replaces without being forced.

The mark is a sentence in the first or the last bytes of a file, where its format has room for a
remark: a comment of XML, Markdown, .msh or a zip archive (.npz), the title of a .vtk, a text chunk
of a .png. A JSON document begins with the key "palpate".
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.temporaries import atomic_path

MARK = "written by palpate, which may replace it"
_MARK = MARK.encode()
# Where a mark is looked for, at both ends of a file [bytes].
_ENDS = 512
_JSON = re.compile(rb'\A\s*\{\s*"palpate(_case)?"\s*:')
# A stored reference is known by its last array, its hash.
_REFERENCE = b"sha256.npy"
_VTK_TITLE = re.compile(rb"(# vtk DataFile[^\n]*\n)[^\n]*")
# Length of the signature and the first chunk of a .png [bytes].
_PNG_HEAD = 33
# The run's outputs: somebody else's file that comes there meanwhile stays.
_guarded: set[Path] = set()


def may_replace(path: str | Path) -> bool:
    """Whether nothing is lost where a file is replaced: it is missing, empty or palpate's own."""
    try:
        if not stat.S_ISREG(Path(path).stat().st_mode):  # a pipe would wait for a writer
            return False
        with Path(path).open("rb") as file:
            start = file.read(_ENDS)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _ENDS))
            end = file.read(_ENDS)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    is_own = _MARK in start or _MARK in end or _JSON.match(start) is not None
    return not start or is_own or (start[:2] == b"PK" and _REFERENCE in end)


def guard(path: str | Path, *, force: bool = False) -> None:
    """Let `own_path` replace this file only where `may_replace` still allows it, or by force."""
    if force:
        _guarded.difference_update(_names(path))
    else:
        _guarded.update(_names(path))


def _names(path: str | Path) -> set[Path]:
    """As it is named and where it leads: a folder may become a link while a run computes."""
    return {Path(path).absolute(), Path(os.path.realpath(path))}


@contextmanager
def own_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path, as `atomic_path` does; the file gets palpate's mark.

    Raises:
        InputError: The path is guarded, and somebody else's file has come there since; what was
            written is left beside it.
    """
    target = Path(os.path.realpath(path))
    with atomic_path(path) as temporary:
        yield temporary
        add_mark(temporary)
        if _names(path) & _guarded and not may_replace(target):
            beside = target.with_name(f"{target.stem}-{secrets.token_hex(3)}{target.suffix}")
            temporary.replace(beside)
            raise InputError(
                f"{path}: a file that palpate did not write has come there since the run began; "
                f"what was computed is in {beside.name}, beside it"
            )


def write_own_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text with palpate's mark, whole or not at all."""
    with own_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def add_mark(path: Path) -> None:
    """Add palpate's mark to a finished file, in the way of its format."""
    with path.open("rb+") as file:
        start = file.read(_ENDS)
        if start[:2] == b"PK":
            with zipfile.ZipFile(file, "a") as archive:
                archive.comment = _MARK
        elif start[:4] == b"\x89PNG":
            rest = start[_PNG_HEAD:] + file.read()
            chunk = b"tEXtComment\0" + _MARK
            length, check = len(chunk) - 4, zlib.crc32(chunk)
            file.seek(_PNG_HEAD)
            file.write(length.to_bytes(4, "big") + chunk + check.to_bytes(4, "big") + rest)
        elif start.startswith(b"# vtk"):
            file.seek(0)
            titled = _VTK_TITLE.sub(rb"\1" + _MARK, file.read(), count=1)
            file.seek(0)
            file.write(titled)
        elif not start.lstrip().startswith(b"{"):
            is_msh = start.startswith(b"$MeshFormat")
            file.seek(0, os.SEEK_END)
            file.write(
                b"$Comments\n%b\n$EndComments\n" % _MARK if is_msh else b"<!-- %b -->\n" % _MARK
            )
