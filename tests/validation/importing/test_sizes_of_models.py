"""A small model that stands for a large one is refused before the memory or the time is taken."""

import itertools
import time

import bars
import pytest
from limits import refusal, run_limited

IMPORT = """
from pathlib import Path
from palpate.validation.importing import UnitSystem, import_model
import_model(Path(sys.argv[1]), Path(sys.argv[1]).with_name("case.toml"), UnitSystem("mm-N-MPa"))
"""
RANGES = "1, 9999999\n"


def refused(path, text, **limits):
    path.write_text(text, encoding="utf-8")
    return refusal(IMPORT, path, **limits)


@pytest.mark.parametrize("keyword", ["NSET", "ELSET"])
def test_a_generated_set_is_no_longer_than_what_the_file_lists(tmp_path, keyword):
    text = bars.abaqus().replace(
        "*MATERIAL", f"*{keyword}, {keyword}=MANY, GENERATE\n{40 * RANGES}*MATERIAL", 1
    )
    assert len(text) < 20_000
    words = refused(tmp_path / "m.inp", text, most_bytes=2e9, seconds=60)
    assert "1 to 9999999 by 1 names more than the " in words


@pytest.mark.parametrize("keyword", ["NSET", "ELSET"])
def test_sets_of_sets_do_not_grow_without_end(tmp_path, keyword):
    known = "ALLNODES" if keyword == "NSET" else "ALL"
    names = [known, *(f"S{k}" for k in range(12))]
    sets = "".join(
        f"*{keyword}, {keyword}={new}\n{', '.join(8 * [old])}\n"
        for old, new in itertools.pairwise(names)
    )
    path = tmp_path / "m.inp"
    path.write_text(bars.abaqus().replace("*MATERIAL", sets + "*MATERIAL", 1), encoding="utf-8")
    # Eight times itself is itself: the last set has the first one's members.
    done = run_limited(IMPORT, path, most_bytes=2e9, seconds=60)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "case.toml").exists()


def test_surfaces_that_list_a_set_again_and_again_are_refused(tmp_path):
    lines = "ALL, S1\nALL, S2\nALL, S3\nALL, S4\n" * 30_000
    text = bars.abaqus().replace("*MATERIAL", f"*SURFACE, NAME=MANY\n{lines}*MATERIAL", 1)
    words = refused(tmp_path / "m.inp", text, most_bytes=3e9, seconds=60)
    assert "more than 10000000 nodes and elements" in words


def test_node_sets_of_febio_that_list_one_another_do_not_grow(tmp_path):
    lines = "<node_set>Held</node_set>" * 200_000
    text = bars.febio(version="3.0").replace(
        "</Mesh>", f'<NodeSet name="many">{lines}</NodeSet></Mesh>', 1
    )
    words = refused(tmp_path / "m.feb", text, most_bytes=3e9, seconds=60)
    assert "<NodeSet> lists 'Held' twice" in words


def test_a_model_of_more_elements_than_are_read_is_refused_at_once(tmp_path):
    elements = '<elem id="1">1,2</elem>' * 2_600_000
    text = bars.febio().replace("</Elements>", elements + "</Elements>", 1)
    path = tmp_path / "m.feb"
    path.write_text(text, encoding="utf-8")
    started = time.process_time()
    words = refusal(IMPORT, path, most_bytes=2e9, seconds=60)
    assert time.process_time() - started < 20
    assert "elements of XML; at most 2500000" in words
    assert words.startswith("ImportRefusedError m.feb: 26001")  # how many there are
