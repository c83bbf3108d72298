"""Damaged, cut-off and hostile models are refused or read; they end nothing and fetch nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import FileFormatError, InputError
from palpate.validation.importing import ImportRefusedError, UnitSystem, import_model, xml_tree

WORDS = (
    "nan", "-inf", "1e308", "-1e308", "1e-320", "0", "-1", "3", "99999999999999999999", '"x"', "[]",
    "<", ">", "&amp;", "&#0;", "&x;", "*", "*STEP", ",", "\x00", "\u00e9", "\n", "1:5", "..",
    "<!-- ", "]]>", "=", "1e400",
)  # fmt: skip
COUNT = 100
TOKEN = re.compile(r"[\w.+-]+|[<>/=\",*]")
BOMB = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>
<febio_spec version="4.0">&c;</febio_spec>"""
OUTSIDE = '<?xml version="1.0"?><!DOCTYPE a SYSTEM "file:///etc/hostname"><febio_spec/>'


def mutants(whole: str, count: int, seed: int) -> Iterator[str]:
    """So many damaged copies of a text, each with one to three wounds."""
    rng = np.random.default_rng(seed)
    spans = [m.span() for m in TOKEN.finditer(whole)]
    for _ in range(count):
        text = whole
        for _ in range(int(rng.integers(1, 4))):
            kind, start = rng.integers(4), int(rng.integers(max(len(text), 1)))
            stop = start + int(rng.integers(1, 60))
            if kind == 0:
                text = text[:start] + text[stop:]
            elif kind == 1:
                text = text[:stop] + text[start:]
            else:
                first, last = spans[int(rng.integers(len(spans)))]
                text = text[:first] + WORDS[int(rng.integers(len(WORDS)))] + text[last:]
        yield text


@pytest.fixture(scope="module")
def models(bars: ModuleType) -> dict[str, str]:
    # Few cells: wounds in long lists of numbers are all alike.
    mesh = brick_box((1, 1, 1), bars.SIZE)
    held = '<bc type="zero displacement" node_set="Held"><x_dof>1</x_dof><y_dof>1</y_dof>'
    held += "<z_dof>1</z_dof></bc>"
    pulled = '<surface_load type="pressure" surface="EndFace"><pressure lc="1">1e-3</pressure>'
    pulled += '</surface_load><body_load type="body force"><force>0,0,9</force></body_load>'
    curve = '<LoadData><load_controller id="1" type="loadcurve"><points><pt>0,0</pt><pt>1,1</pt>'
    curve += "</points></load_controller></LoadData>"
    cells = " ".join(map(str, mesh.cells.ravel().tolist()))
    points = " ".join(map(repr, mesh.points.ravel().tolist()))
    return {
        ".feb": bars.febio(mesh, boundary=held, loads=pulled, extra=curve),
        ".inp": bars.abaqus(
            mesh, material="*DENSITY\n1e-9\n*HYPERELASTIC, NEO HOOKE\n0.02, 12.5",
            acts="*CLOAD\n8, 3, 1e-4\n*DLOAD\nALL, GRAV, 9.8, 0, 0, -1\n*DSLOAD\nENDFACE, P, 1e-3",
        ),
        ".xml": f'<mujoco><worldbody><flexcomp name="b" type="direct" dim="3" point="{points}" '
        f'element="{cells}"><elasticity young="1e4" poisson="0.3"/><pin range="0 3"/></flexcomp>'
        "</worldbody></mujoco>",
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("ending", [".feb", ".inp", ".xml"])
def test_a_damaged_model_is_refused_or_becomes_a_case(
    tmp_path: Path, models: dict[str, str], ending: str, seed: int
) -> None:
    whole, path, target = models[ending], tmp_path / f"m{ending}", tmp_path / "case.toml"
    path.write_text(whole)
    import_model(path, target, UnitSystem.MILLIMETRE_NEWTON)
    for text in mutants(whole, COUNT, seed):
        path.write_bytes(text.encode("utf-8", "replace"))
        try:
            with np.errstate(all="ignore"):
                import_model(path, target, UnitSystem.MILLIMETRE_NEWTON)
        except InputError:
            continue
        except Exception as error:
            raise AssertionError(f"{type(error).__name__}: {error}; {text!r}"[:4000]) from error


@pytest.mark.parametrize("ending", [".feb", ".inp", ".xml"])
def test_a_model_that_is_cut_off_is_refused(
    tmp_path: Path, models: dict[str, str], ending: str
) -> None:
    whole, path = models[ending], tmp_path / f"m{ending}"
    # All that is needed of an .inp stands before its requests of output.
    last = whole.index("*NODE PRINT") if ending == ".inp" else len(whole.rstrip())
    for part in np.linspace(0.0, 0.98, 15):
        path.write_text(whole[: int(part * last)])
        with pytest.raises(InputError):
            import_model(path, tmp_path / "case.toml", UnitSystem.MILLIMETRE_NEWTON)
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", [".feb", ".xml"])
@pytest.mark.parametrize("text", [BOMB, OUTSIDE])
def test_document_types_and_entities_are_refused(tmp_path: Path, ending: str, text: str) -> None:
    path = tmp_path / f"m{ending}"
    path.write_text(text)
    with pytest.raises(ImportRefusedError, match="document type"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)


def test_depth_and_size_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "m.feb"
    path.write_text("<a>" * 100 + "</a>" * 100)
    with pytest.raises(ImportRefusedError, match="nested more than 50 deep"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
    path.write_text("<febio_spec>" + "<b/>" * 200 + "</febio_spec>")
    monkeypatch.setattr(xml_tree, "_MOST_ELEMENTS", 100)
    with pytest.raises(ImportRefusedError, match="more than 100 elements"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
    monkeypatch.setattr(xml_tree, "MOST_BYTES", 100)
    with pytest.raises(FileFormatError, match="at most 100 bytes"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)


@pytest.mark.parametrize("ending", [".feb", ".inp", ".xml"])
def test_what_is_no_file_is_refused(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"m{ending}"
    for make in (lambda: None, lambda: path.mkdir()):
        make()
        with pytest.raises(InputError):
            import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
