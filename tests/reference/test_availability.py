"""What must work without FEniCSx, and what is said when it is missing."""

from __future__ import annotations

import subprocess
import sys

import pytest

from palpate.reference import availability
from palpate.reference.child import child_environment
from palpate.reference.errors import (
    ReferenceCrashedError,
    ReferenceFailedError,
    ReferenceNotConvergedError,
    ReferenceTimeoutError,
    ReferenceUnavailableError,
)


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
    told = ReferenceCrashedError(1, "Traceback\npetsc4py.PETSc.Error: error code 76\n[0] noise\n")
    assert "error code 76" in str(told)
    assert "no message" in str(ReferenceCrashedError(-6, ""))
    assert "30 s" in str(ReferenceTimeoutError(30.0))
    for error in (lost, told):
        assert isinstance(error, ReferenceFailedError)
