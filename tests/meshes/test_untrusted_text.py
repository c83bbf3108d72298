"""JSON and TOML of others: plain data, or a refusal in one line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from palpate.meshes.errors import FileFormatError
from palpate.meshes.untrusted_text import (
    DEEPEST,
    UntrustedTextError,
    parse_json,
    parse_toml,
    read_text,
)


def test_plain_data_comes_through() -> None:
    assert parse_json('{"a": [1, 2.5, null, true, "x"]}') == {"a": [1, 2.5, None, True, "x"]}
    assert parse_toml('a = [1, 2.5, true]\n[b]\nc = "x"') == {"a": [1, 2.5, True], "b": {"c": "x"}}


@pytest.mark.parametrize("depth", [DEEPEST + 1, 1000, 100_000])
@pytest.mark.parametrize(
    ("parse", "opening", "inner", "closing"),
    [
        (parse_json, "[", "1", "]"),
        (parse_json, '{"a":', "1", "}"),
        (parse_toml, "[", "1", "]"),
        (parse_toml, "{a=", "1", "}"),
    ],
)
def test_deep_nesting_is_refused(
    parse: object, opening: str, inner: str, closing: str, depth: int
) -> None:
    text = opening * depth + inner + closing * depth
    assert callable(parse)
    with pytest.raises(UntrustedTextError, match="nested"):
        parse(text if parse is parse_json else f"x = {text}")


def test_a_key_of_a_thousand_parts_is_deep_too() -> None:
    with pytest.raises(UntrustedTextError, match="nested"):
        parse_toml(".".join(["a"] * 1000) + " = 1")


@pytest.mark.parametrize("text", ["NaN", "[Infinity]", '{"a": -Infinity}', "1e999", "[[-1e400]]"])
def test_numbers_without_end_are_no_json_unless_they_are_expected(text: str) -> None:
    with pytest.raises(UntrustedTextError):
        parse_json(text)
    parse_json(text, allow_nan=True)


@pytest.mark.parametrize("digits", [400, 5000])
def test_whole_numbers_that_no_float_holds_are_refused(digits: int) -> None:
    for allow_nan in (True, False):
        with pytest.raises(UntrustedTextError):
            parse_json("1" * digits, allow_nan=allow_nan)


def test_what_is_no_plain_file_of_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "large").write_bytes(b"x" * 101)
    os.mkfifo(tmp_path / "pipe")
    for name in ("loop", "bytes", "missing", "pipe", "large", ".", "a\0b"):
        with pytest.raises(FileFormatError):
            read_text(tmp_path / name, most_bytes=100)
