"""`palpate import`: what it prints, its exit codes, and what it writes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from palpate.meshes.errors import InputError
from palpate.validation.case import load_case
from palpate.validation.commands.case_files import import_model
from palpate.validation.importing import UnitSystem
from palpate.validation.output_files import OutputError
from palpate.validation.report.preview import describe_case

MODEL = """*HEADING
One cell
*NODE
1, 0., 0., 0.
2, 10., 0., 0.
3, 0., 10., 0.
4, 0., 0., 10.
*ELEMENT, TYPE=C3D4, ELSET=ALL
1, 1, 2, 3, 4
*MATERIAL, NAME=M
*ELASTIC
0.01, 0.3
*SOLID SECTION, ELSET=ALL, MATERIAL=M
*BOUNDARY
1, 1, 3
2, 1, 3
3, 1, 3
*STEP, NLGEOM
*STATIC
*CLOAD
4, 3, -0.01
*NODE FILE
U
*END STEP
"""


def test_a_model_becomes_a_case_that_can_be_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, target = tmp_path / "one.inp", tmp_path / "one.toml"
    model.write_text(MODEL)
    with pytest.raises(InputError, match="give --units"):
        import_model(model, target)
    assert not target.exists()
    import_model(model, target, UnitSystem.MILLIMETRE_NEWTON)
    said = capsys.readouterr().out
    assert "note: forces on 1 node(s)" in said
    assert "left out: line 22 *NODE FILE" in said
    assert "10 x 10 x 10 mm" in said
    assert f"palpate report {target}" in said
    assert describe_case(load_case(target)).lines[0] in said
    with pytest.raises(OutputError, match="is there already"):
        import_model(model, target, UnitSystem.MILLIMETRE_NEWTON)
    target.unlink()
    with pytest.raises(OutputError, match=r"one\.msh: is there already"):
        import_model(model, target, UnitSystem.MILLIMETRE_NEWTON)


@pytest.mark.long
def test_what_no_case_can_hold_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "one.inp").write_text(MODEL.replace("C3D4", "C3D20"))
    done = subprocess.run(
        [
            sys.executable, "-m", "palpate.validation.cli", "import", str(tmp_path / "one.inp"),
            "-o", str(tmp_path / "one.toml"), "--units", "mm-N-MPa",
        ],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "one.inp:8: *ELEMENT, TYPE=C3D20" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["one.inp"]
