from __future__ import annotations

import contextlib
import itertools
import os
import string
from pathlib import Path
from typing import Annotated, Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field

from testbed.document_errors import mistake
from testbed.documents import LARGEST_FILE, parse_document, read_document, validate
from testbed.errors import UserError


class Wheel(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["wheel"] = "wheel"
    radius: float = Field(0.1, gt=0, le=1, json_schema_extra={"unit": "m"})


class Leg(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kind: Literal["leg"] = "leg"
    length: float = Field(ge=0.01, le=2, json_schema_extra={"unit": "m"})
    turn_deg: float = Field(0.0, ge=-90, le=90)


class Machine(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    name: str = Field("m", pattern="^[a-z]+$")
    count: int = Field(1, ge=1)
    fast: bool = False
    size: tuple[float, float] = (1.0, 2.0)
    limbs: dict[str, Annotated[Wheel | Leg, Field(discriminator="kind")]] = Field(default_factory=dict)


def test_values_mean_what_they_look_like() -> None:
    text = """
    whole: 12
    signed: [-3, +4]
    real: [0.5, .5, 1., 1e-3, -2.5E+2]
    truth: [true, False]
    nothing: [null, ~, ]
    words: [yes, on, off, No, 1:30, 1_000, 0x10, 010, 2020-01-01, =, 1e]
    quoted: ['12', "true", <<]
    block: |
      two
      lines
    """
    assert parse_document(text).data == {
        "whole": 12,
        "signed": [-3, 4],
        "real": [0.5, 0.5, 1.0, 0.001, -250.0],
        "truth": [True, False],
        "nothing": [None, None],
        "words": ["yes", "on", "off", "No", "1:30", "1_000", "0x10", "010", "2020-01-01", "=", "1e"],
        "quoted": ["12", "true", "<<"],
        "block": "two\nlines\n",
    }


def test_keys_are_words_as_written() -> None:
    assert parse_document("on: 1\n2: 2\ntrue: 3\n").data == {"on": 1, "2": 2, "true": 3}


def test_every_place_has_its_line() -> None:
    source = parse_document("a: 1\nb:\n  - c: 2\n    d:\n      - 3\n  - [4,\n     5]\n").source
    expected = {("a",): 1, ("b",): 2, ("b", 0): 3, ("b", 0, "c"): 3, ("b", 0, "d"): 4, ("b", 0, "d", 0): 5}
    expected |= {("b", 1): 6, ("b", 1, 1): 7}
    assert {place: source.line(place) for place in expected} == expected
    assert source.line(("b", 0, "nowhere")) == 3  # the nearest thing around it


BAD_TEXTS = [
    ("", 1, "empty"),
    ("# only a comment\n", 1, "empty"),
    ("just words", 1, "no 'key: value' lines"),
    ("- a\n- b", 1, "no 'key: value' lines"),
    ("a: 1\nb: 2\na: 3", 3, "key 'a' stands twice, first in line 1"),
    ("a: 1\nb: {c: 1, c: 2}", 2, "key 'c' stands twice, first in line 2"),
    ("a: &x 1\n", 1, "write the value out"),
    ("a: 1\nb: *x", 2, "write the value out"),
    ("a: !!python/object/apply:os.system [ls]", 1, "tags are not read"),
    ("a: !secret x", 1, "tags are not read"),
    ("a: !!binary aGk=", 1, "tags are not read"),
    ("a: 1\n\tb: 2", 2, "spaces, not tabs"),
    ("a: [1, 2\n", 1, "close the bracket"),
    ("a: 'open\n", 1, "close the bracket or quote"),
    ("a: b: c", 1, "in quotes"),
    ("a: 1\nb 2\nc: 3", 3, "each line is 'key: value'"),
    ("a: 1\n---\nb: 2", 2, "keep one document"),
    ("? [1]\n: 2", 1, "a key must be a plain word"),
    ('a: 1\nb: "\\ud800"', 2, "lone surrogate"),
    ('a: 1\nb: "\\UFFFFFFFF"', 2, "escapes"),
    ('a: "\\q"', 1, "escape"),
    ("a: 1\nb: \0", 2, "remove it"),
    ("a: @x", 1, "cannot start any token"),
    ("a: 1\nb: .inf", 2, "not a finite number"),
    ("a: -.INF", 1, "not a finite number"),
    ("a: nan", 1, "not a finite number"),
    ("a: 1e999", 1, "not a finite number"),
    ("a: " + "9" * 5000, 1, "too large"),
    ("a: 10000000000000000", 1, "too large"),
    ("a: " + "[" * 5000, 1, "nested more than"),
    ("\n".join(" " * depth + "a:" for depth in range(60)), 40, "nested more than"),
    ("%YAML 9.0\n---\na: 1", 1, "malformed YAML"),
]


@pytest.mark.parametrize(("text", "line", "expected"), BAD_TEXTS)
def test_bad_text_is_refused_with_its_line_and_a_mend(text: str, line: int, expected: str) -> None:
    with pytest.raises(UserError) as caught:
        parse_document(text, "x.yaml")
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    assert expected in str(caught.value)
    assert caught.value.mend
    assert len(str(caught.value)) < 300


def test_nested_aliases_cannot_explode() -> None:
    bomb = "a: &a [x, x]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}]\n" for a, b in itertools.pairwise("abcdefghijk")
    )
    with pytest.raises(UserError, match="anchors and aliases"):
        parse_document(bomb)


BAD_DATA = [
    ("nmae: x", 1, "unknown key 'nmae'; did you mean 'name'?"),
    ("zzzzz: x", 1, "the known keys are name, count, fast, size, limbs"),
    ("count: 1\nname: 5", 2, "name must be text, not 5; put it in quotes"),
    ("name: on\ncount: yes", 2, "count must be a whole number, not the text 'yes'"),
    ("count: 2.0", 1, "whole number, not 2.0"),
    ("count: true", 1, "count must be a whole number, not true"),
    ("count: '3'", 1, "without a point, quotes"),
    ("count: 0", 1, "count must be at least 1, not 0"),
    ("count:", 1, "count has no value"),
    ("name:", 1, "write it after the colon, or remove the key"),
    ("fast: yes", 1, "fast must be true or false, not the text 'yes'; write true or false"),
    ("fast: 1", 1, "fast must be true or false, not 1"),
    ("name: A B", 1, "name cannot be the text 'A B'"),
    ("size: 3", 1, "size must be a list, not 3"),
    ("size: [3]", 1, "size has too few values; give 2"),
    ("size: [3, 4, 5]", 1, "size has 3 values; give at most 2"),
    ("size:\n- 1\n- 1:30", 3, "size[1] must be a number, not the text '1:30'"),
    ("limbs: [1]", 1, "limbs must be a mapping"),
    ("limbs:\n  a:\n    kind: leg", 2, "limbs.a has no 'length'; add 'length: ...'"),
    ("limbs:\n  a:\n    kind: leg\n    length: 14", 4, "lengths are in metres; did you mean 0.14 (14 cm)?"),
    (
        "limbs:\n  a: {kind: leg, length: 250}",
        2,
        "between 0.01 and 2 m, not 250; lengths are in metres; did you",
    ),
    ("limbs:\n  a: {kind: leg, length: 1500}", 2, "did you mean 1.5 (1500 mm)?"),
    ("limbs:\n  a: {kind: leg, length: 1000000}", 2, "not 1000000; lengths are in metres"),
    ("limbs:\n  a: {kind: leg, length: -1}", 2, "limbs.a.length must be between 0.01 and 2 m, not -1"),
    (
        "limbs:\n  a:\n    kind: wheel\n    radius: 0",
        4,
        "limbs.a.radius must be above 0 and at most 1 m, not 0",
    ),
    ("limbs:\n  a: {kind: leg, length: 1, turn_deg: 180}", 2, "between -90 and 90 degrees, not 180"),
    (
        "limbs:\n  a: {kind: legg, length: 1}",
        2,
        "limbs.a.kind cannot be the text 'legg'; did you mean 'leg'?",
    ),
    ("limbs:\n  a: {length: 1}", 2, "limbs.a has no 'kind'"),
    (
        "limbs:\n  a:\n    kind: leg\n    lenght: 1",
        4,
        "unknown key 'lenght' in limbs.a; did you mean 'length'? (and 1 m",
    ),
    ("count: 0\nsize: 3\nfast: 2\n", 1, "(and 2 more)"),
    ("count: 0\nsize: 3\nfats: 2\n", 3, "unknown key 'fats'; did you mean 'fast'? (and 2 more)"),
    ("count: zero\nname: " + "X" * 500, 1, "(and 1 more)"),
]


@pytest.mark.parametrize(("text", "line", "expected"), BAD_DATA)
def test_bad_data_are_refused_with_their_line_and_a_mend(text: str, line: int, expected: str) -> None:
    with pytest.raises(UserError) as caught:
        validate(Machine, parse_document(text, "x.yaml"))
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    assert expected in str(caught.value)
    assert caught.value.mend


def test_good_data_become_the_model() -> None:
    text = "{count: 2, fast: true, size: [1, 1e1], limbs: {a: {kind: leg, length: 1}, b: {kind: wheel}}}"
    machine = validate(Machine, parse_document(text))
    assert machine.size == (1.0, 10.0)
    assert machine.limbs == {"a": Leg(length=1.0), "b": Wheel()}


def test_long_values_are_cut_and_braces_are_text() -> None:
    with pytest.raises(UserError) as caught:
        validate(Machine, parse_document("name: " + "X{0}" * 500))
    assert len(str(caught.value)) < 250
    error = mistake("unknown '{x}'", "try '{0}'")
    assert error.message() == "unknown '{x}'; try '{0}'"


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("a: 1")
    (tmp_path / "latin.yaml").write_bytes("a: 1\nb: caf\u00e9".encode("latin-1"))
    (tmp_path / "big.yaml").write_bytes(b"#" * (LARGEST_FILE + 1))
    (tmp_path / "binary.yaml").write_bytes(bytes(range(256)))
    os.mkfifo(tmp_path / "pipe.yaml")
    for name, expected in {
        "robto.yaml": "there is no such file; did you mean 'robot.yaml'?",
        "zzz": "there is no such file; the folder has big.yaml, binary.yaml, latin.yaml",
        "no/robot.yaml": "there is no such file; there is no folder",
        ".": "this is a folder",
        "latin.yaml": "latin.yaml:2: the file is no UTF-8 text; save it as UTF-8",
        "big.yaml": f"larger than {LARGEST_FILE / 1024:g} KiB",
        "binary.yaml": "no UTF-8 text",
        "pipe.yaml": "no ordinary file",
        "a\0b": "cannot read the file",
        "x" * 5000: "cannot read the file",
        "robot.yaml/x": "cannot read the file",
    }.items():
        with pytest.raises(UserError) as caught:
            read_document(tmp_path / name)
        assert expected in str(caught.value)
        assert caught.value.mend


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    document = read_document(tmp_path / "x.yaml")
    assert document.data == {"a": 1, "b": 2}
    assert document.source.line(("b",)) == 2


@given(st.binary(max_size=200))
def test_any_bytes_give_a_document_or_a_user_error(
    tmp_path_factory: pytest.TempPathFactory, raw: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_bytes(raw)
    with contextlib.suppress(UserError):
        assert isinstance(read_document(path).data, dict)


@given(
    st.text(
        alphabet=string.ascii_letters + string.digits + " \n\t:-[]{}&*!|>'\"%@`#,?.~\\/<=_+\u00e9\x85\u2028"
    )
)
def test_any_text_gives_a_document_or_a_user_error(text: str) -> None:
    with contextlib.suppress(UserError):
        assert isinstance(parse_document(text).data, dict)


plain_data = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**15), 10**15)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.from_regex("[a-z][a-z ]{0,8}[a-z]", fullmatch=True).filter(
        lambda word: word not in {"true", "false", "null", "nan", "inf", "infinity"}  # refused, as numbers
    ),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text("abc", min_size=1), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(st.dictionaries(st.text("abc", min_size=1), plain_data, min_size=1), st.booleans())
def test_what_pyyaml_writes_is_read_back(data: dict[str, object], flow: bool) -> None:
    text = yaml.safe_dump(data, default_flow_style=flow)
    if "&" not in text:  # PyYAML's own aliases for equal objects
        assert parse_document(text).data == data
