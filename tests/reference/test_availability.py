"""Whether FEniCSx is here, and where its compiled forms are stored."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading

import pytest

from palpate.reference import availability, jit_cache
from palpate.reference.child import child_environment
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceFailedError,
    ReferenceNotConvergedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)
from palpate.reference.jit_cache import cache_folder, compiled_in, locked, remove_unfinished


def test_the_caller_s_modules_do_not_load_fenicsx():
    program = (
        "import sys\n"
        "from palpate.reference import availability, child, errors, result, jit_cache\n"
        "availability.is_available(), availability.versions()\n"
        "loaded = {'dolfinx', 'petsc4py', 'ufl', 'mpi4py'} & set(sys.modules)\n"
        "assert not loaded, loaded\n"
    )
    subprocess.run([sys.executable, "-P", "-c", program], check=True, env=child_environment())


def test_missing_fenicsx_is_an_error_with_the_remedy(monkeypatch):
    monkeypatch.setattr(availability.importlib.util, "find_spec", lambda _name: None)
    assert not availability.is_available()
    with pytest.raises(ReferenceUnavailableError, match="apt-get install python3-dolfinx"):
        availability.require_available()


def test_versions_name_python_and_what_is_installed():
    versions = availability.versions()
    assert versions["python"] == ".".join(map(str, sys.version_info[:3]))
    assert availability.is_available() == ("dolfinx" in versions)


def test_messages_name_the_value_and_the_remedy():
    lost = ReferenceNotConvergedError(0.504, "a cell would invert", 0.33)
    assert "0.504" in str(lost)
    assert "a cell would invert" in str(lost)
    assert lost.displacement.shape == (0, 3)
    assert "SIGSEGV" in str(ReferenceCrashedError(-11, "noise\n"))
    reported = ReferenceCrashedError(
        1, "Traceback\npetsc4py.PETSc.Error: error code 76\n[0] noise\n"
    )
    assert "error code 76" in str(reported)
    assert "no message" in str(ReferenceCrashedError(-6, ""))
    assert "30 s" in str(ReferenceTimeoutError(30.0))
    for error in (lost, reported):
        assert isinstance(error, ReferenceFailedError)


def test_the_folder_is_private_and_named_by_versions(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_folder("0.11.0")
    assert folder.parent == tmp_path / "palpate"
    assert "dolfinx-0.11.0" in folder.name
    assert folder.stat().st_mode & 0o077 == 0
    assert cache_folder("0.5.2") != folder


def test_a_home_that_cannot_be_written_is_no_obstacle(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    folder = cache_folder("0.11.0")
    assert folder.is_dir()
    assert folder.is_relative_to(tmp_path)


def test_where_nothing_can_be_kept_a_folder_lasts_as_long_as_its_process(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / f"palpate-{os.getuid()}").write_text("in the way")
    program = (
        "import stat\n"
        "from palpate.reference.jit_cache import cache_folder\n"
        "folder = cache_folder('0.11.0')\n"
        "assert stat.S_IMODE(folder.stat().st_mode) == 0o700\n"
        "(folder / 'form.c').write_text('x'); print(folder.parent)\n"
    )
    positions = {"XDG_CACHE_HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        env={**child_environment(), **positions},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == f"{tmp_path}\n", done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", f"palpate-{os.getuid()}"]


def test_only_unfinished_sources_are_removed(tmp_path):
    for name in ("done.c", "done.c.cached", "half.c", "half.o"):
        (tmp_path / name).write_text("")
    assert remove_unfinished(tmp_path) == ["half.c"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["done.c", "done.c.cached", "half.o"]


def compiled(folder, name: str) -> None:
    """Files as FFCx leaves them of a form."""
    (folder / f"{name}.c").write_text("int f;")
    (folder / f"{name}.o").write_bytes(b"object")
    (folder / f"{name}.cpython-311-x86_64-linux-gnu.so").write_bytes(b"library of " + name.encode())
    (folder / f"{name}.c.cached").write_text("")


def test_a_compiled_form_is_used_as_it_was_compiled_or_compiled_again(tmp_path, monkeypatch):
    def use() -> list[str]:
        """The forms that are there when the first one of a process is asked for."""
        monkeypatch.setattr(jit_cache, "_CHECKED", set())
        return compiled_in(
            tmp_path, lambda: sorted(path.name[:4] for path in tmp_path.glob("*.c.cached"))
        )

    def compile_both() -> str:
        compiled(tmp_path, "mass")
        compiled(tmp_path, "load")
        return "made"

    assert compiled_in(tmp_path, compile_both) == "made"
    assert use() == ["load", "mass"]
    library = next(tmp_path.glob("mass.*.so"))
    library.write_bytes(library.read_bytes()[:-1] + b"x")  # a bit on the disk
    assert use() == ["load"]
    assert not list(tmp_path.glob("mass.*"))
    compiled_in(tmp_path, compile_both)
    assert use() == ["load", "mass"]
    next(tmp_path.glob("load.*.so")).unlink()
    (tmp_path / "mass.sha256").unlink()  # nobody can say what it is
    assert use() == []
    compiled_in(tmp_path, compile_both)
    monkeypatch.setattr(jit_cache, "made_by", lambda: "ffcx 0.6, another compiler")
    assert use() == []


def test_forms_that_another_process_uses_are_removed_when_it_is_done(tmp_path, monkeypatch):
    compiled(tmp_path, "mass")
    monkeypatch.setattr(jit_cache, "_CHECKED", set())
    is_there = []
    with contextlib.ExitStack() as other:
        other.enter_context(locked(tmp_path, alone=False))
        thread = threading.Thread(
            target=lambda: compiled_in(
                tmp_path, lambda: is_there.append((tmp_path / "mass.c").exists())
            )
        )
        thread.start()
        thread.join(0.5)
        assert (tmp_path / "mass.c").exists()
    thread.join(30.0)
    assert is_there == [False]


def test_the_lock_dies_with_its_holder(tmp_path):
    program = (
        "import os, pathlib, sys\n"
        "from palpate.reference.jit_cache import locked\n"
        "with locked(pathlib.Path(sys.argv[1])):\n"
        "    os.abort()\n"
    )
    killed = subprocess.run(
        [sys.executable, "-P", "-c", program, str(tmp_path)],
        env=child_environment(),
        stderr=subprocess.DEVNULL,
        check=False,
    )
    assert killed.returncode == -6
    with locked(tmp_path):
        assert (tmp_path / "lock").exists()


def test_who_shares_the_lock_keeps_out_who_wants_it_alone(tmp_path):
    with locked(tmp_path, alone=False), locked(tmp_path, alone=False, wait=False) as shared:
        assert shared
        with locked(tmp_path, wait=False) as alone:
            assert not alone
    with locked(tmp_path, wait=False) as alone, locked(tmp_path, alone=False, wait=False) as shared:
        assert (alone, shared) == (True, False)


def test_a_form_that_a_dead_run_left_is_compiled_anew(tmp_path):
    source = tmp_path / "form.c"
    source.write_text("")

    def compiles():
        if source.exists():
            raise TimeoutError
        return "made"

    assert compiled_in(tmp_path, compiles) == "made"


def test_a_form_that_another_process_compiles_is_waited_for_and_left_alone(tmp_path):
    source, calls = tmp_path / "form.c", []
    source.write_text("")
    with contextlib.ExitStack() as other:
        other.enter_context(locked(tmp_path, alone=False))

        def compiles():
            calls.append(source.exists())
            if len(calls) < 5:
                raise TimeoutError
            other.close()
            return "made"

        assert compiled_in(tmp_path, compiles) == "made"
    assert calls == [True] * 5


def test_what_never_comes_is_an_error(tmp_path):
    def compiles():
        raise TimeoutError("no form")

    with pytest.raises(TimeoutError, match="no form"):
        compiled_in(tmp_path, compiles)
