"""Damaged, cut-off and hostile models are refused or read; they end nothing and fetch nothing."""

import bars
import numpy as np
import pytest
from damage import damaged_copies, only_refusals

from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import FileFormatError, InputError
from palpate.validation.importing import ImportRefusedError, UnitSystem, import_model, xml_tree

COUNT = 100
BOMB = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]>
<febio_spec version="4.0">&c;</febio_spec>"""
OUTSIDE = '<?xml version="1.0"?><!DOCTYPE a SYSTEM "file:///etc/hostname"><febio_spec/>'


@pytest.fixture(scope="module")
def models():
    # Few cells: wounds in long lists of numbers are all alike.
    mesh = brick_box((1, 1, 1), bars.SIZE)
    pulled = '<surface_load type="pressure" surface="EndFace"><pressure lc="1">1e-3</pressure>'
    pulled += '</surface_load><body_load type="body force"><force>0,0,9</force></body_load>'
    cells = " ".join(map(str, mesh.cells.ravel().tolist()))
    points = " ".join(map(repr, mesh.points.ravel().tolist()))
    return {
        ".feb": bars.febio(mesh, loads=pulled),
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
def test_a_damaged_model_is_refused_or_becomes_a_case(tmp_path, models, ending, seed):
    whole, path, target = models[ending], tmp_path / f"m{ending}", tmp_path / "case.toml"
    path.write_text(whole)
    import_model(path, target, UnitSystem.MILLIMETRE_NEWTON)
    for data in damaged_copies(whole.encode(), COUNT, seed):
        path.write_bytes(data)
        with only_refusals(data):
            import_model(path, target, UnitSystem.MILLIMETRE_NEWTON)


@pytest.mark.parametrize("ending", [".feb", ".inp", ".xml"])
def test_a_model_that_is_cut_off_is_refused(tmp_path, models, ending):
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
def test_document_types_and_entities_are_refused(tmp_path, ending, text):
    path = tmp_path / f"m{ending}"
    path.write_text(text)
    with pytest.raises(ImportRefusedError, match="document type"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)


def test_depth_and_size_are_bounded(tmp_path, monkeypatch):
    path = tmp_path / "m.feb"
    path.write_text("<a>" * 100 + "</a>" * 100)
    with pytest.raises(ImportRefusedError, match="nested more than 50 deep"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
    path.write_text("<febio_spec>" + "<b/>" * 200 + "</febio_spec>")
    monkeypatch.setattr(xml_tree, "MOST_ELEMENTS", 100)
    with pytest.raises(ImportRefusedError, match="201 elements of XML; at most 100"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
    monkeypatch.setattr(xml_tree, "MOST_BYTES", 100)
    with pytest.raises(FileFormatError, match="at most 100 bytes"):
        import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)


@pytest.mark.parametrize("ending", [".feb", ".inp", ".xml"])
def test_what_is_no_file_is_refused(tmp_path, ending):
    path = tmp_path / f"m{ending}"
    for make in (lambda: None, lambda: path.mkdir()):
        make()
        with pytest.raises(InputError):
            import_model(path, tmp_path / "case.toml", UnitSystem.METRE_NEWTON)
