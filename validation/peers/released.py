"""Released versions of a package, each installed in a Python environment of its own.

All that speaks with the package index is pip, by its own configuration; nothing that it prints,
which may name the index, is shown or stored. Only wheels are installed: nothing is built here.
Environments are stored in a cache, $XDG_CACHE_HOME/palpate/released or ~/.cache/palpate/released.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from palpate.meshes.errors import InputError
from palpate.meshes.fingerprint import file_hash
from palpate.meshes.temporaries import own_mark, sweep

try:
    import fcntl
except ImportError:  # Windows: two at once install twice, and one of them fails at its renaming
    fcntl = None  # type: ignore[assignment]

# Time that pip has for one version [s], and how often the size of its folder is looked at [s].
_TIME_LIMIT = 600.0
_LOOK = 0.2
_WHEELS = "wheels.json"
_HALF_INSTALLED = re.compile(r"\..+-(?P<process>\d+)-[0-9a-f]{8}")
_NUMBERS = re.compile(r"\d+(\.\d+)*(\.post\d+)?")


class NotInstalledError(Exception):
    """A version that cannot be installed here, in words that name no index."""


@dataclass(frozen=True)
class Installed:
    """A version in an environment of its own.

    Attributes:
        version: The version.
        python: Its interpreter.
        wheels: SHA-256 of each installed wheel by file name.
        is_new: Whether it was installed by this call.
        size: Bytes of the environment.
    """

    version: str
    python: Path
    wheels: dict[str, str]
    is_new: bool
    size: int


def cache_folder() -> Path:
    """The folder of environments; it may not exist."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "palpate" / "released"


def numbers_of(version: str) -> tuple[int, ...]:
    """The numbers of a version such as 3.17.0, by which versions are sorted.

    Raises:
        InputError: It is no such version.
    """
    if not _NUMBERS.fullmatch(version):
        raise InputError(f"--versions: {version!r} is no version; write numbers, such as 3.17.0")
    return tuple(int(part) for part in re.findall(r"\d+", version))


def in_range(versions: Sequence[str], asked: str) -> list[str]:
    """The versions from the first to the last of FIRST:LAST, both included, oldest first.

    Either may be missing, and 4.0 as the last takes in 4.0.1; a single version is itself.
    Pre-releases are left out.

    Raises:
        InputError: It is no range, or no version is in it.
    """
    first, colon, last = asked.partition(":")
    if not colon:
        last = first
    low = numbers_of(first) if first else ()
    high = numbers_of(last) if last else ()
    released = sorted((v for v in versions if _NUMBERS.fullmatch(v)), key=numbers_of)
    found = [
        v
        for v in released
        if numbers_of(v) >= low and (not high or numbers_of(v)[: len(high)] <= high)
    ]
    if not found:
        shown = ", ".join(released[-8:]) or "none"
        raise InputError(f"--versions {asked}: none of these was released; the latest are {shown}")
    return found


def released_versions(package: str) -> list[str]:
    """Every version of a package that pip finds for this Python and system.

    Raises:
        InputError: pip finds none, or cannot reach the index.
    """
    done = _pip(["index", "versions", package], None, None)
    found = re.search(r"^Available versions: (.+)$", done, re.MULTILINE)
    if found is None:
        raise InputError(f"pip finds no version of {package}: is the package index reachable?")
    return [version.strip() for version in found[1].split(",")]


def installed(package: str, version: str, others: Sequence[str], most_bytes: int) -> Installed:
    """A version in its environment, installed where it is not in the cache.

    Args:
        package: Name of the package.
        version: The version of it.
        others: Packages that its adapter needs besides, in whatever version fits.
        most_bytes: Bytes that download and environment may take together.

    Raises:
        NotInstalledError: No wheels of it are found, they take more space or time, or pip fails.
    """
    folder = _folder_of(package, version, others)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _alone(folder):
        is_new = not (folder / _WHEELS).is_file()
        if is_new:
            sweep(folder.parent, _HALF_INSTALLED, partial(shutil.rmtree, ignore_errors=True))
            _install(folder, f"{package}=={version}", others, most_bytes)
    wheels = json.loads((folder / _WHEELS).read_text("utf-8"))
    return Installed(version, folder / "bin" / "python", wheels, is_new, size_of(folder))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process installs this environment; the system frees a dead one's lock."""
    with folder.with_name(f"{folder.name}.lock").open("w") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def is_cached(package: str, version: str, others: Sequence[str]) -> bool:
    """Whether nothing has to be downloaded for a version and what is beside it."""
    return (_folder_of(package, version, others) / _WHEELS).is_file()


def _folder_of(package: str, version: str, others: Sequence[str]) -> Path:
    # What is installed beside it in a version of its own makes another environment.
    bound = [re.sub(r"\W+", "_", other) for other in others if not re.fullmatch(r"[\w-]+", other)]
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    return cache_folder() / "-".join([package, version, python, *bound])


def size_of(folder: Path) -> int:
    """Bytes of all files in a folder, links as such; files that vanish meanwhile are none."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(parent, name)).st_size  # noqa: PTH118
            except FileNotFoundError:
                continue
    return total


def _install(folder: Path, asked: str, others: Sequence[str], most_bytes: int) -> None:
    fresh = folder.with_name(f".{folder.name}-{own_mark()}")
    wheels = fresh / "wheels"
    try:
        (fresh / "tmp").mkdir(parents=True, mode=0o700)
        command = [sys.executable, "-m", "venv", "--without-pip", str(fresh)]
        subprocess.run(command, check=True, capture_output=True)
        wanted = [asked, *others]
        _pip(["download", "--no-cache-dir", "-d", str(wheels), *wanted], fresh, most_bytes)
        hashes = {wheel.name: file_hash(wheel) for wheel in sorted(wheels.iterdir())}
        offline = ["--no-index", "--find-links", str(wheels), "--no-compile"]
        _pip(
            ["--python", str(fresh / "bin" / "python"), "install", *offline, *wanted],
            fresh,
            most_bytes,
        )
        shutil.rmtree(wheels)
        shutil.rmtree(fresh / "tmp")
        (fresh / _WHEELS).write_text(json.dumps(hashes, indent=1) + "\n", "utf-8")
        shutil.rmtree(folder, ignore_errors=True)  # one without its list of wheels is incomplete
        fresh.rename(folder)
    except (OSError, subprocess.CalledProcessError) as error:
        raise NotInstalledError(f"no environment can be made ({type(error).__name__})") from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _pip(words: list[str], folder: Path | None, most_bytes: int | None) -> str:
    """What pip prints, of a call that may fill a folder.

    Raises:
        NotInstalledError: It fails, or takes more space or time than it may.
        InputError: There is no such folder and it fails.
    """
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", "PIP_NO_INPUT": "1"}
    environment["PIP_ONLY_BINARY"] = ":all:"
    environment.pop("PYTHONPATH", None)
    if folder is not None:
        environment["TMPDIR"] = str(folder / "tmp")
    began = time.monotonic()
    with subprocess.Popen(
        [sys.executable, "-m", "pip", *words],
        stdout=subprocess.PIPE if folder is None else subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
        env=environment,
        text=True,
    ) as pip:
        try:
            if folder is None:
                out, _ = pip.communicate(timeout=_TIME_LIMIT)
                return out
            while pip.poll() is None:
                if most_bytes is not None and size_of(folder) > most_bytes:
                    raise NotInstalledError("it takes more space than --disk leaves")
                if time.monotonic() - began > _TIME_LIMIT:
                    raise NotInstalledError(f"pip took more than {_TIME_LIMIT:g} s")
                time.sleep(_LOOK)
        except subprocess.TimeoutExpired:
            return ""
        finally:
            if pip.poll() is None:
                pip.kill()
    if pip.returncode:
        raise NotInstalledError(
            "pip finds no wheels of it for this Python, or cannot reach the index"
        )
    return ""
