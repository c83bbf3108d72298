"""Another repository gates its toy simulator with the built wheel alone, without FEniCSx."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "validation" / "examples" / "gate_your_simulator"


def run(*words: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # type: ignore[call-overload,no-any-return]
        [str(word) for word in words], capture_output=True, text=True, check=False, **options
    )


@pytest.fixture(scope="session")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An interpreter of a fresh environment with the wheel in it; dolfinx cannot be imported."""
    folder = tmp_path_factory.mktemp("environment")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    venv.create(folder / "venv", with_pip=False)
    home = folder / "venv"
    site = next((home / "lib").glob("python3*")) / "site-packages"
    installed = run(
        sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", site, wheel,
        "--disable-pip-version-check", env=environment,
    )  # fmt: skip
    assert installed.returncode == 0, installed.stderr
    # What the wheel depends on is borrowed from this environment; FEniCSx is not.
    borrowed = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    borrowed |= {p for p in sys.path if p.endswith(("site-packages", "dist-packages"))}
    (site / "borrowed.pth").write_text("\n".join(sorted(borrowed)) + "\n", encoding="utf-8")
    for name in ("dolfinx", "dolfinx_solver"):
        (site / f"{name}.py").write_text("raise ImportError('not here')\n", encoding="utf-8")
    return home / "bin" / "python"


@pytest.mark.once
# However long the machine takes to build the wheel is no part of the verdict.
@pytest.mark.timeout(0)
@pytest.mark.slow
def test_a_second_repository_gates_its_simulator(python: Path, tmp_path: Path) -> None:
    repository = tmp_path / "mysim"
    shutil.copytree(EXAMPLE, repository)
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "GITHUB_ACTIONS")}

    def gate(simulator: str, *options: str) -> subprocess.CompletedProcess[str]:
        return run(
            python, "-m", "palpate.validation.cli", "gate", "bar.toml", "--simulator",
            f"{python} {simulator} {{case}} {{result}}", *options, cwd=repository, env=environment,
        )  # fmt: skip

    where = run(python, "-c", "import palpate.meshes; print(palpate.meshes.__file__)",
                cwd=repository, env=environment)  # fmt: skip
    assert str(python.parent.parent) in where.stdout, where.stdout + where.stderr
    good = gate("toy_simulator.py", "--junit", "junit.xml", "--summary", "summary.md")
    assert good.returncode == 0, good.stdout + good.stderr
    assert (repository / "junit.xml").is_file()

    toy = repository / "toy_simulator.py"
    softer = toy.read_text("utf-8").replace(
        'rest["youngs_modulus"]', '0.98 * rest["youngs_modulus"]'
    )
    (repository / "softer.py").write_text(softer, encoding="utf-8")
    bad = gate("softer.py")
    assert bad.returncode == 1, bad.stdout + bad.stderr
    assert "displacement_l2" in bad.stdout

    (repository / "references" / "bar.npz").unlink()
    missing = gate("toy_simulator.py")
    assert missing.returncode == 2, missing.stdout + missing.stderr


@pytest.mark.once
@pytest.mark.timeout(0)
@pytest.mark.slow
def test_the_wheel_holds_what_is_needed_and_the_notices_of_what_is_linked_in(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        notices = [name for name in names if name.endswith("THIRD_PARTY_LICENSES.txt")]
        reported = archive.read(notices[0]).decode("utf-8")
    suffixes = {Path(name).suffix for name in names if ".dist-info/" not in name}
    assert suffixes == {
        ".py", ".pyi", ".typed", ".so", ".toml", ".npz", ".vtu",
        ".j2", ".css", ".js", ".md", ".yml", ".xz", ".csv", "",
    }  # fmt: skip
    # Measured data have their licence beside them.
    without = [name for name in names if ".dist-info/" not in name and not Path(name).suffix]
    assert without == ["palpate/validation/cases/silicone_beam/LICENSE"]
    assert [".dist-info/licenses/" in name for name in notices] == [True]
    assert "nanobind" in reported
    assert "robin-map" in reported
    assert not any("/tests/" in name or "/documentation/" in name for name in names)


def test_the_workflow_file_says_the_one_command_and_pins_its_permissions() -> None:
    text = (EXAMPLE / ".github" / "workflows" / "palpate.yml").read_text("utf-8")
    assert "palpate gate bar.toml" in text
    assert "permissions:\n  contents: read" in text
    assert "\t" not in text
