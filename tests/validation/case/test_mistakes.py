"""Mistakes in a case file are answered with what was meant and where it stands."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from palpate.meshes.errors import InputError
from palpate.validation.case import CaseError, load_case
from palpate.validation.case.body_schema import Count, Flag, Number
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.units import Units

Write = Callable[..., Path]

LOAD = 'kind = "force"\nforce = [60.0, 20.0, -10.0]\n'
PULLED = "region = { half_space = { point = [1.999, 0.0, 0.0], normal = [1.0, 0.0, 0.0] } }"
BOX = 'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5'
MOVED = '[tool]\nshape = "sphere"\nradius = 1.0\n'


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        ('"displacement_l2"', '"displacment_l2"', "displacement_l2"),
        ('"displacement_l2"', '"Displacement_L2"', "displacement_l2"),
        ("limit = 1e-8", 'limit = 1e-8\nagainst = "samemesh"', "same_mesh"),
        ("limit = 1e-8", 'limit = 1e-8\nagainst = "thruth"', "truth"),
        ("limit = 1e-8", "tolerance = 1e-8", "limit"),
        ('reason = "same equations"', 'reson = "same equations"', "reason"),
        ('kind = "force"', 'kind = "froce"', "force"),
        (LOAD + PULLED, 'kind = "gravity"\naccelaration = [0.0, 0.0, -9.8]', "acceleration"),
        (LOAD + PULLED, 'kind = "gravity"\ng = [0.0, 0.0, -9.8]', "acceleration"),
        (LOAD, 'kind = "pressure"\npresure = 3.0\n', "pressure"),
        (LOAD, 'kind = "traction"\ntracton = [1.0, 0.0, 0.0]\n', "traction"),
        (LOAD, LOAD + "amplitud = { times = [0], factors = [1] }\n", "amplitude"),
        ('shape = "box"', 'shape = "bxo"', "box"),
        ("[[support]]", '[[support]]\ncomponents = ["X"]', "x"),
        ("half_space = { point = [0.001", "halfspace = { point = [0.001", "half_space"),
        ("[geometry]", '[units]\nlength = "MM"\n[geometry]', "mm"),
        ("[geometry]", '[units]\nlenght = "mm"\n[geometry]', "length"),
        ("title =", 'strain = "grene"\ntitle =', "green"),
        ("[material]", "[mesh]\nsize = 0.5\n[material]", "edge_length"),
        ("[material]", '[mesh]\nmesher = "gmesh"\n[material]', "gmsh"),
        ("edge_length = 0.5", "h = 0.5", "edge_length"),
        ("edge_length = 0.5", "element_size = 0.5", "edge_length"),
        ("youngs_modulus = 1000.0", "E = 1000.0", "youngs_modulus"),
        ("poissons_ratio = 0.3", "nu = 0.3", "poissons_ratio"),
        ("poissons_ratio = 0.3", "poissons_ratio = 0.3\nrho = 900", "density"),
        ("[[support]]", "[time]\nend_time = 1\ndt = 0.1\n[[support]]", "time_step"),
        ("[[support]]", f"{MOVED}pose = [{{time = 0, positon = [0]}}]\n[[support]]", "position"),
    ],
)  # fmt: skip
def test_a_mistake_in_writing_is_answered_with_what_was_meant(
    write_case: Write, old: str, new: str, meant: str
) -> None:
    with pytest.raises(CaseError) as refused:
        load_case(write_case((old, new)))
    assert f"did you mean {meant!r}?" in str(refused.value)
    assert len(str(refused.value).splitlines()) <= 2


@pytest.mark.parametrize(
    "geometry",
    [
        'shape = "sphere"\nradius = 1.0\nsize = 0.1',
        'shape = "sphere"\nradius = 1.0\nsize = [0.1, 0.1, 0.1]',
        'shape = "kidney"\nsize = [0.1, 0.1, 0.1]',
        'surface = "liver.stl"\nsize = [0.1, 0.1, 0.1]',
    ],
)
def test_size_where_edge_length_is_meant_is_told(write_case: Write, geometry: str) -> None:
    with pytest.raises(CaseError, match="cells are sized by edge_length"):
        load_case(write_case((BOX, geometry)))


def test_a_word_that_resembles_nothing_gets_the_choice(write_case: Write) -> None:
    with pytest.raises(CaseError, match="use box, beam, cylinder, sphere, kidney"):
        load_case(write_case(('shape = "box"', 'shape = "zzz"')))
    with pytest.raises(CaseError, match=re.escape("'load.1.kind'; add it: force, traction")):
        load_case(write_case(('kind = "force"\n', "")))


def test_a_missing_key_is_told_at_its_own_table(write_case: Write) -> None:
    path = write_case(("limit = 1e-8\n", ""))
    line = path.read_text("utf-8").split("[[check]]")[0].count("\n") + 1
    with pytest.raises(CaseError, match=rf":{line}: missing key 'check.1.limit'"):
        load_case(path)


MM = (
    ("[geometry]", '[units]\nlength = "mm"\nstress = "kPa"\n[geometry]'),
    ("size = [2.0, 1.0, 1.0]\nedge_length = 0.5", "size = [20.0, 10.0, 10.0]\nedge_length = 5.0"),
)
HELD = "region = { half_space = { point = [0.001, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] } }"
CHECK = 'metric = "displacement_l2"\nlimit = 1e-8\nreason = "same equations"'
PUBLISHED = (
    'metric = "published_displacement"\nagainst = "candidate"\nat = [20.0, 0.0, 0.3]\n'
    'component = "x"\nexpected = 1.0\nlimit = 0.1\nreason = "x"'
)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            [(HELD, "region = { box = { min = [90, 0, 0], max = [99, 1, 1] } }")],
            "from [0.0, 0.0, 0.0] to [20.0, 10.0, 10.0] mm",
        ),
        (
            [(CHECK, PUBLISHED), (PULLED, "region = { nearest = [19.9, 0, 0] }"),
             ('kind = "force"', 'kind = "point_force"')],
            "at [20.0, 0.0, 0.3] mm: no point of the mesh lies there, the nearest at "
            "[20.0, 0.0, 0.0] mm",
        ),
        (
            [('shape = "box"\nsize = [20.0, 10.0, 10.0]\nedge_length = 5.0',
              'shape = "kidney"\nedge_length = 100.0')],
            "edge_length = 100 mm is too coarse",
        ),
    ],
)  # fmt: skip
def test_places_are_told_in_the_cases_unit_before_anything_is_solved(
    write_case: Write, changes: list[tuple[str, str]], told: str
) -> None:
    case = load_case(write_case(*MM, *changes))
    with pytest.raises(InputError, match=re.escape(told)):
        _ = case.problem


def test_lengths_of_a_message_are_turned_and_nothing_else() -> None:
    told = Units(length="mm").in_case_units
    assert (
        told("at (0.06, -1.5e-3, 0) m; at most 0.003 m is")
        == "at (60, -1.5, 0) mm; at most 3 mm is"
    )
    assert told("[0.1, 0.2] m") == "[100, 200] mm"
    for kept in ("2 m/s", "1e-9 m3", "3 mm", "9.8 m/s2", "4 more", 'it said "moved 0.003 m"'):
        assert told(kept) == kept
    assert Units().in_case_units("0.003 m") == "0.003 m"


@pytest.mark.parametrize("name", ["loop.stl", "a\\u0000b.stl", "x" * 5000, ".", "/dev/zero"])
def test_a_path_that_cannot_be_followed_is_an_input_error(write_case: Write, name: str) -> None:
    path = write_case((BOX, f'surface = "{name}"'))
    (path.parent / "loop.stl").symlink_to("loop.stl")
    with pytest.raises(InputError):
        _ = load_case(path).problem


def test_a_case_that_is_no_plain_text_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "deep.toml").write_text("x = " + "[" * 1000 + "]" * 1000, encoding="utf-8")
    (tmp_path / "keys.toml").write_text(".".join(["a"] * 1000) + " = 1", encoding="utf-8")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xff")
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    for name in ("loop", "deep", "keys", "bytes", "pipe", "folder", "missing"):
        with pytest.raises(CaseError):
            load_case(tmp_path / f"{name}.toml")


@pytest.mark.parametrize(
    "geometry",
    [
        'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 1e-3',
        'shape = "box"\nsize = [1e308, 1.0, 1.0]\nedge_length = 1.0',
        'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 1e-320',
        'shape = "beam"\nlength = 1e9\nwidth = 1e9\nheight = 1e-9\nedge_length = 1.0',
        'shape = "sphere"\nradius = 1.0\nedge_length = 1e-9',
        'shape = "cylinder"\nradius = 1.0\nheight = 1e9\nedge_length = 0.01',
        'shape = "kidney"\nedge_length = 1e-9',
        'shape = "box"\nsize = [2.0, 1.0, 1.0]\nedge_length = 0.5\n[mesh]\nedge_length = 1e-6',
    ],
)
def test_a_size_that_asks_for_cells_without_end_is_refused(
    write_case: Write, geometry: str
) -> None:
    with pytest.raises(InputError, match="asks for some"):
        _ = load_case(write_case((BOX, geometry))).problem


# Each key with the text that stands there; the block case has them, or gets them.
NUMBERS = {
    "limit": "limit = 1e-8",
    "youngs_modulus": "youngs_modulus = 1000.0",
    "poissons_ratio": "poissons_ratio = 0.3",
    "edge_length": "edge_length = 0.5",
    "force": "force = [60.0,",
    "point": "point = [0.001,",
    "size": "size = [2.0,",
}
NOT_NUMBERS = ["true", '"1e300"', "inf", "-nan", "1" + "0" * 400, "2020-01-01", "{}"]


@pytest.mark.parametrize("value", NOT_NUMBERS)
@pytest.mark.parametrize("key", NUMBERS)
def test_what_is_no_finite_number_is_refused_with_line_and_key(
    write_case: Write, key: str, value: str
) -> None:
    old = NUMBERS[key]
    new = re.sub(r"[-\d.]+(e-8)?(?=,?$)", value, old)
    path = write_case((old, new))
    line = path.read_text("utf-8").split(new)[0].count("\n") + 1
    with pytest.raises(CaseError) as refused:
        load_case(path)
    first = str(refused.value).splitlines()[0]
    assert re.match(rf"{re.escape(str(path))}:{line}: \S*\b{key}\b", first)
    assert len(first) < 300


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("schema = 1", "schema = true", "schema"),
        ("schema = 1", 'schema = "1"', "schema"),
        ('shape = "box"', 'shape = "box"\nrepair = 1', "repair"),
        ("[[support]]", '[mesh]\ngrade = [{smallest = 1.0, boundary = 1}]\n[[support]]', "grade"),
        ("[[support]]", "[time]\nend_time = true\n[[support]]", "end_time"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = 2.0\n[[support]]", "num_outputs"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = true\n[[support]]", "num_outputs"),
        ("[[support]]", "[time]\nend_time = 1\nnum_outputs = 99999999\n[[support]]", "num_outputs"),
        ("[[support]]", "[[support]]\namplitude = {times = [true], factors = [1]}", "times"),
        ("[[support]]", '[[support]]\namplitude = {times = [0], factors = ["1"]}', "factors"),
        ("[[support]]", "[[support]]\ndisplacement = [0, false, 0]", "displacement"),
    ],
)  # fmt: skip
def test_truth_values_text_and_counts_are_told_apart(
    write_case: Write, old: str, new: str, key: str
) -> None:
    with pytest.raises(CaseError, match=key):
        load_case(write_case((old, new)))


def models(annotation: Any) -> Iterator[Any]:
    """Every type that an annotation is made of."""
    yield annotation
    for part in get_args(annotation):
        yield from models(part)


def test_no_key_of_the_schema_takes_a_bare_number_type() -> None:
    seen: set[type[BaseModel]] = set()
    bare, waiting = [], [CaseSpec]
    while waiting:
        model = waiting.pop()
        seen.add(model)
        for name, field in model.model_fields.items():
            # Annotated[float, validator] is taken apart by pydantic where it is the whole type.
            whole = field.metadata and any(m in field.metadata for m in _checks())
            for part in models(field.annotation):
                if isinstance(part, type) and issubclass(part, BaseModel) and part not in seen:
                    waiting.append(part)
                if part in (float, int, bool) and not whole and not _is_within(field.annotation):
                    bare.append(f"{model.__name__}.{name}")
    assert len(seen) > 15
    assert bare == []


def _checks() -> list[Any]:
    return [get_args(kind)[1] for kind in (Number, Count, Flag)]


def _is_within(annotation: Any) -> bool:
    """Whether a checked number is among the parts."""
    return any(
        check in getattr(part, "__metadata__", ()) for part in models(annotation)
        for check in _checks()
    )  # fmt: skip


@pytest.mark.parametrize(
    ("entry", "place"),
    [
        ("when = 2020-01-01", "published.when"),
        ("when = 12:30:00", "published.when"),
        ("when = 2020-01-01T12:30:00Z", "published.when"),
        ("volume = nan", "published.volume"),
        ("deep.rows = [[1, 2], [3, inf]]", "published.deep.rows.2.2"),
        ("huge = 1" + "0" * 400, "published.huge"),
    ],
)
def test_published_holds_only_what_a_results_file_can(
    write_case: Write, entry: str, place: str
) -> None:
    with pytest.raises(CaseError, match=re.escape(place)):
        load_case(write_case(("[geometry]", f"[published]\n{entry}\n[geometry]")))


def test_published_keeps_text_numbers_truth_values_and_tables(write_case: Write) -> None:
    entry = 'volume = 1.5\nwho = "me"\nis_old = true\nrows = [[1, 2.5]]\ndeep.key = 3'
    case = load_case(write_case(("[geometry]", f"[published]\n{entry}\n[geometry]")))
    assert case.spec.published == {
        "volume": 1.5, "who": "me", "is_old": True, "rows": [[1, 2.5]], "deep": {"key": 3},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("force = [60.0,", "force = [1e308,", "load 1"),
        (
            "[[load]]",
            "[[load]]\nkind = 'gravity'\nacceleration = [0, 0, -1e308]\n[[load]]",
            "load 1",
        ),
        ("[[support]]", "[[support]]\ndisplacement = [1e200, 0, 0]", "support 1"),
        (
            "[[support]]",
            "[[support]]\ndisplacement = [1, 0, 0]\namplitude = {times = [0], factors = [1e200]}",
            "support 1",
        ),
    ],
)
def test_what_is_too_large_to_compute_with_is_refused_by_its_place(
    write_case: Write, old: str, new: str, what: str
) -> None:
    path = write_case((old, new))
    with pytest.raises(InputError, match=f"{what}: .*too large to compute with; lower it"):
        _ = load_case(path).problem
