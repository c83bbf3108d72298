"""Versions in the provenance are those of what is installed."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.validation.case import load_case
from palpate.validation.judging.judge import judge_case
from palpate.validation.versions import version_of


def test_the_version_is_that_of_the_package() -> None:
    assert version_of("numpy") == np.__version__
    assert version_of("no-such-package") == "sources in place"


def test_the_provenance_of_a_result_names_palpates_own() -> None:
    told = judge_case(load_case("confined")).provenance
    assert told["palpate"] == version_of("palpate")
    assert told["numpy"] == np.__version__


def test_the_provenance_of_a_result_holds_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["/usr/bin/palpate", "gate", "confined"])
    assert judge_case(load_case("confined")).provenance["command"] == "palpate gate confined"
