"""Models written by hand, imported, and solved by their own simulator too where it is installed."""

import pytest
import simulators

from palpate.validation.case import load_case
from palpate.validation.importing import UnitSystem, import_model
from palpate.validation.peers.registry import interpreter_with, interpreters


@pytest.fixture(scope="session")
def mujoco_if_there():
    """A process of MuJoCo, or None."""
    process = simulators.MuJoCo() if interpreter_with("mujoco") else None
    yield process
    if process is not None:
        process.close()


@pytest.fixture
def mujoco(mujoco_if_there):
    """A process of MuJoCo; what needs it is skipped without."""
    if mujoco_if_there is None:
        pytest.skip(f"MuJoCo is not installed in {interpreters()}")
    return mujoco_if_there


@pytest.fixture
def bring(tmp_path, mujoco_if_there):
    """Write a model's text to a file, import it, and load the case.

    Every model that becomes a case here is solved by CalculiX or MuJoCo too, where that can be: not
    where cells were cut or have middle nodes, which is another mesh.
    """

    def bring(text, ending, units=UnitSystem.MILLIMETRE_NEWTON):
        path = tmp_path / f"model{ending}"
        path.write_text(text, encoding="utf-8")
        target = tmp_path / "case.toml"
        imported = import_model(path, target, units)
        case = load_case(target)
        is_same_mesh = not any("cut into" in n or "quadratic" in n for n in imported.notes)
        if ending == ".inp" and simulators.has_ccx and is_same_mesh:
            folder = tmp_path / "own"
            folder.mkdir(exist_ok=True)
            for included in tmp_path.glob("*.inc"):
                (folder / included.name).write_bytes(included.read_bytes())
            # A pressed face is that of an increment before, in ccx: 4e-4 off in four of them.
            fine = text.replace("0.25, 1.\n", "0.01, 1., 0.001, 0.01\n")
            metres = 1e-3 if units.startswith("mm") else 1.0
            simulators.agree_with_ccx(folder, fine, case, metres)
        if ending == ".xml" and mujoco_if_there is not None:
            mujoco_if_there.agree(path, case)
        return case, imported

    return bring
