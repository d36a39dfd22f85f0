from __future__ import annotations

import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.errors import UserError, did_you_mean


def test_an_error_is_one_line_with_file_line_what_and_mend() -> None:
    error = UserError("unknown key 'distnce'", "did you mean 'distance'?", file="scenarios/x.yaml", line=12)
    assert str(error) == "scenarios/x.yaml:12: unknown key 'distnce'; did you mean 'distance'?"


def test_parts_that_are_not_known_leave_no_trace() -> None:
    assert str(UserError("what")) == "what"
    assert str(UserError("what", "mend")) == "what; mend"
    assert str(UserError("what", file="x.yaml")) == "x.yaml: what"


def test_files_below_the_working_directory_are_shown_relative(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert str(UserError("what", file=tmp_path / "a" / "x.yaml", line=1)) == "a/x.yaml:1: what"


@given(st.text(), st.text(), st.text())
def test_no_text_breaks_the_line(what: str, mend: str, file: str) -> None:
    assert len(str(UserError(what, mend, file=file, line=1)).splitlines()) <= 1


def test_an_error_survives_the_way_between_processes() -> None:
    error = UserError("what", "mend", file="x.yaml", line=3)
    copy = pickle.loads(pickle.dumps(error))
    assert isinstance(copy, UserError)
    assert (str(copy), copy.what, copy.mend, copy.file, copy.line) == (
        str(error),
        "what",
        "mend",
        "x.yaml",
        3,
    )


@pytest.mark.parametrize(
    ("word", "known", "expected"),
    [
        ("crawlr", ["splayed", "crawler"], "did you mean 'crawler'?"),
        ("CRAWLER", ["splayed", "crawler"], "did you mean 'crawler'?"),
        ("zzz", ["splayed", "crawler"], "the known robots are splayed, crawler"),
        ("zzz", [], "there are no known robots"),
    ],
)
def test_a_wrong_word_is_answered_by_the_nearest_or_by_all(
    word: str, known: list[str], expected: str
) -> None:
    assert did_you_mean(word, known, kind="robots") == expected
