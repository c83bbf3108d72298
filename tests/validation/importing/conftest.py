"""Models written by hand, imported, and solved."""

import pytest

from palpate.validation.case import load_case
from palpate.validation.importing import UnitSystem, import_model


@pytest.fixture
def bring(tmp_path):
    """Write a model's text to a file, import it, and load the case."""

    def bring(text, ending, units=UnitSystem.MILLIMETRE_NEWTON):
        path = tmp_path / f"model{ending}"
        path.write_text(text, encoding="utf-8")
        target = tmp_path / "case.toml"
        imported = import_model(path, target, units)
        return load_case(target), imported

    return bring
