"""Files that appear whole or not at all: written under a temporary name, then renamed."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.meshes.temporaries import held, own_mark, sweep

_TEMPORARY = re.compile(r"\..+\.palpate-(?P<process>\d+)-[0-9a-f]{8}\.tmp(\.\w+)?")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, renamed onto it when the block succeeds.

    The temporary name keeps the suffix, since writers choose the format by it. On any failure,
    Ctrl-C included, the temporary file is removed and an old `path` stays as it was. A link stays
    a link: what it points to is replaced.
    """
    target = Path(os.path.realpath(path))
    _sweep_beside(target.parent)
    name = f".{target.stem[:40]}.palpate-{own_mark()}.tmp{target.suffix}"
    temporary = target.with_name(name)
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    try:
        with held(temporary):
            yield temporary
            with temporary.open("rb+") as written:
                os.fsync(written.fileno())
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # 0600 would lock colleagues out
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text_atomically(path: str | Path, text: str) -> None:
    """Write UTF-8 text so that `path` holds the old text or the new, never a part."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@functools.cache
def _sweep_beside(folder: Path) -> None:
    """Remove what killed runs left here; once in a process."""
    sweep(folder, _TEMPORARY, Path.unlink)
