"""`palpate init` and `palpate schema`: every key is there, described, and what stands is valid."""

import json
import re
import tomllib

import numpy as np
import pytest

import palpate as palpate_api
from palpate.meshes.bricks import brick_box
from palpate.meshes.errors import InputError
from palpate.meshes.files import write_mesh, write_surface
from palpate.meshes.shapes import shape_sphere
from palpate.meshes.tri_surface import TriSurface
from palpate.validation.case import builtin_cases, builtin_folder, load_case
from palpate.validation.case.schema import CaseSpec
from palpate.validation.case.schema_keys import editor_schema, tables_of
from palpate.validation.case.writing import first_case


def all_models(model, seen):
    seen.add(model)
    for field in model.model_fields.values():
        for kind in tables_of(field):
            if kind not in seen:
                all_models(kind, seen)
    return seen


def test_every_key_of_a_first_case_has_what_the_schema_says_beside_it(tmp_path):
    text = first_case(None, target=tmp_path / "my.toml")
    lines = text.splitlines()
    # Nothing is a comment any more, and all of it is TOML.
    assert tomllib.loads(re.sub(r"^#(?=[a-z\[])", "", text, flags=re.MULTILINE))
    models = all_models(CaseSpec, set())
    assert sum(len(model.model_fields) for model in models) > 80
    for model in models:
        for name, field in model.model_fields.items():
            assert field.description, (model, name)
            key = re.escape(field.alias or name)
            pattern = re.compile(rf"#?({key} = |\[+([a-z_]+\.)*{key}\])")
            described = (line for line in lines if f"  # {field.description}" in line)
            assert any(map(pattern.match, described)), (model.__name__, name)


def test_a_first_case_without_a_body_is_valid_as_it_stands_and_passes(tmp_path, palpate_run):
    path = tmp_path / "my.toml"
    done = palpate_run("init", "-o", path)
    assert done.returncode == 0, done.stderr
    case = load_case(path)
    state = palpate_api.solve(case.problem)
    # Said: 5 % of 60 mm by linear strain, 3 mm; under Green's a pull of this size is a little less.
    assert 0.0027 < state.max_displacement < 0.0031
    assert path.read_text("utf-8").count("GUESS") >= 4


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_supports_and_loads_are_guessed_from_the_extents_of_a_surface(tmp_path, unit, palpate_run):
    ball = shape_sphere(30.0, edge_length=12.0)
    write_surface(tmp_path / "ball.stl", ball)
    path = tmp_path / "ball.toml"
    done = palpate_run("init", tmp_path / "ball.stl", "-o", path, "--unit", unit)
    assert done.returncode == 0, done.stderr
    problem = load_case(path).problem
    scale = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[unit]
    assert np.ptp(problem.mesh.points, axis=0).max() == pytest.approx(
        np.ptp(ball.points, axis=0).max() * scale,
        rel=1e-6,  # digits of float32, in a binary .stl
    )
    (support,), (load,) = problem.supports, problem.loads
    assert len(support.facets) > 0
    assert len(load.facets) > 0
    linear = palpate_api.solve(problem, strain="linear")
    # Said: 5 %, of a force of three digits.
    length = np.ptp(problem.mesh.points, axis=0).max()
    assert linear.max_displacement == pytest.approx(0.05 * length, rel=6e-3)
    assert "GUESS: the file says no unit" not in path.read_text("utf-8")


def test_a_file_from_elsewhere_is_copied_where_that_is_asked_for(tmp_path, palpate_run):
    (tmp_path / "surfaces").mkdir()
    ball = tmp_path / "surfaces" / "ball.stl"
    write_surface(ball, shape_sphere(30.0, edge_length=12.0))
    case = tmp_path / "cases" / "here.toml"
    case.parent.mkdir()
    done = palpate_run("init", ball, "-o", case)
    assert done.returncode == 2
    assert "--copy" in done.stderr
    assert list(case.parent.iterdir()) == []
    assert palpate_run("init", ball, "--copy", "-o", case).returncode == 0
    assert (case.parent / "ball.stl").read_bytes() == ball.read_bytes()
    # The same file is no other one.
    assert palpate_run("init", ball, "--copy", "-o", case, "--force").returncode == 0
    # Mm was guessed, and that is marked.
    assert "GUESS: the file says no unit of length; it is taken for mm" in case.read_text("utf-8")
    # Another file of that name stays as it is.
    (case.parent / "ball.stl").write_text("mine", "utf-8")
    assert palpate_run("init", ball, "--copy", "-o", case, "--force").returncode == 2
    assert (case.parent / "ball.stl").read_text("utf-8") == "mine"


def test_a_surface_that_cannot_be_meshed_becomes_no_case_and_changes_none(tmp_path, palpate_run):
    one, other = (shape_sphere(1.0, edge_length=0.4) for _ in range(2))
    # Through one another.
    points = np.vstack([one.points, other.points + np.array([0.7, 0.1, 0.2])])
    facets = np.vstack([one.facets, other.facets + len(one.points)])
    write_surface(tmp_path / "both.stl", TriSurface(points, facets))
    case = tmp_path / "both.toml"
    done = palpate_run("init", tmp_path / "both.stl", "-o", case)
    assert done.returncode == 2
    assert "--repair" in done.stderr
    assert not case.exists()
    case.write_text("mine", "utf-8")
    assert palpate_run("init", tmp_path / "both.stl", "-o", case, "--force").returncode == 2
    assert case.read_text("utf-8") == "mine"


@pytest.mark.parametrize(("unit", "asks"), [((), True), (("--unit", "mm"), False)])
def test_a_guessed_unit_that_makes_a_body_of_2_mm_is_asked_about(tmp_path, palpate_run, unit, asks):
    write_surface(tmp_path / "ball.stl", shape_sphere(1.0, edge_length=0.4))
    done = palpate_run("init", tmp_path / "ball.stl", "-o", tmp_path / "ball.toml", *unit)
    assert done.returncode == 0
    words = "the body is 1.959 mm long: is its file really in mm? say --unit"
    assert (words in done.stdout + done.stderr) == asks


def test_a_mesh_file_is_taken_as_the_mesh(tmp_path, palpate_run):
    mesh = brick_box((4, 2, 2), (40.0, 20.0, 20.0))
    write_mesh(tmp_path / "body.vtu", mesh)
    assert palpate_run("init", tmp_path / "body.vtu", "-o", tmp_path / "b.toml").returncode == 0
    case = load_case(tmp_path / "b.toml")
    assert case.spec.geometry.mesh == "body.vtu"
    assert case.problem.mesh.num_cells == mesh.num_cells


def test_what_cannot_be_a_first_case_is_refused_and_nothing_is_overwritten(tmp_path, palpate_run):
    write_surface(tmp_path / "ball.stl", shape_sphere(30.0, edge_length=12.0))
    (tmp_path / "sub").mkdir()
    with pytest.raises(InputError, match="beside the case file"):
        first_case(tmp_path / "ball.stl", target=tmp_path / "sub" / "my.toml")
    mine = tmp_path / "mine.toml"
    mine.write_text("mine", "utf-8")
    done = palpate_run("init", "-o", mine)
    assert done.returncode == 2
    assert "is there already" in done.stderr
    assert mine.read_text("utf-8") == "mine"
    for arguments in (["-o", tmp_path / "a.json"], ["-o", tmp_path / "a.toml", "--unit", "inch"]):
        assert palpate_run("init", *arguments).returncode == 2
    assert palpate_run("init", tmp_path / "none.stl", "-o", tmp_path / "a.toml").returncode == 2


def validate(schema, root, value):
    """The part of draft 7 that the schema uses, enough to tell whether a case is as it says."""
    if "$ref" in schema:
        target = root
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        return validate(target, root, value)
    for word in ("anyOf", "oneOf"):
        if word in schema:
            tried = [validate(one, root, value) for one in schema[word]]
            num_good = sum(not errors for errors in tried)
            is_good = num_good == 1 if word == "oneOf" else num_good > 0
            return [] if is_good else [f"{value!r}: {num_good} of {word} fit: {tried}"]
    if "const" in schema and value != schema["const"]:
        return [f"{value!r} is not {schema['const']!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{value!r} is not one of {schema['enum']}"]
    kinds = {
        "object": dict, "array": list, "string": str, "number": (int, float),
        "integer": int, "boolean": bool,
    }  # fmt: skip
    if "type" in schema and not isinstance(value, kinds[schema["type"]]):
        return [f"{value!r} is no {schema['type']}"]
    errors = []
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        errors += [f"{key} is missing" for key in schema.get("required", []) if key not in value]
        for key, item in value.items():
            if key in properties:
                errors += validate(properties[key], root, item)
            elif schema.get("additionalProperties") is False:
                errors.append(f"{key} is unknown")
    if isinstance(value, list):
        items = schema.get("items", {})
        pairs = zip(items, value, strict=False) if isinstance(items, list) else (
            (items, v) for v in value
        )  # fmt: skip
        errors += [e for one, item in pairs for e in validate(one, root, item)]
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            errors.append(f"{len(value)} items")
    if "exclusiveMinimum" in schema and not value > schema["exclusiveMinimum"]:
        errors.append(f"{value!r} is not above {schema['exclusiveMinimum']}")
    return errors


@pytest.mark.parametrize("name", builtin_cases())
def test_every_built_in_case_is_as_the_schema_for_editors_says(name):
    schema = editor_schema()
    data = tomllib.loads((builtin_folder() / f"{name}.toml").read_text("utf-8"))
    assert validate(schema, schema, data) == []


def test_a_wrong_case_is_not_as_the_schema_for_editors_says():
    schema = editor_schema()
    data = tomllib.loads((builtin_folder() / "kidney.toml").read_text("utf-8"))
    for change in ({"materail": {}}, {"strain": "big"}, {"load": [{"kind": "force"}]}):
        assert validate(schema, schema, {**data, **change})


def test_the_schema_is_draft_seven_without_what_toml_has_not_and_describes_each_key(
    tmp_path, palpate_run
):
    path = tmp_path / "case.schema.json"
    done = palpate_run("schema", "-o", path)
    assert done.returncode == 0, done.stderr
    assert f"#:schema ./{path.name}" in done.stdout
    schema = json.loads(path.read_text("utf-8"))
    assert json.loads(palpate_run("schema").stdout) == schema
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    text = json.dumps(schema)
    assert '"null"' not in text
    assert "prefixItems" not in text
    for kind in (schema, *schema["$defs"].values()):
        for key, found in kind.get("properties", {}).items():
            assert found.get("description"), key
    assert "[units.length]" in schema["$defs"]["BallRegion"]["properties"]["radius"]["description"]
