"""A trial's files: equal trials are equal bytes, and no damage goes unnoticed."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from trial_builder import assert_same, trial_result

from testbed.experiment.record import TrialResult
from testbed.experiment.trial_files import DamagedError, decode, encode

ARRAYS, TABLE = encode(trial_result(3, size=20))


def test_equal_trials_are_equal_bytes_and_need_no_unpickling() -> None:
    arrays, table = encode(trial_result(1))
    assert (arrays, table) == encode(trial_result(1))
    with pytest.raises(TypeError, match="Python objects"):
        encode(TrialResult(rows=(), arrays={"bad": np.array([None, {}])}))


def test_rubbish_instead_of_a_trial_is_noticed() -> None:
    for rubbish in (b"", b"PAR1", b"PAR1" * 10, os.urandom(4000)):
        with pytest.raises(DamagedError):
            decode(ARRAYS, rubbish)
        with pytest.raises(DamagedError):
            decode(rubbish, TABLE)


@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@example("table", 10320, 63)  # changes the type of a column
@given(st.sampled_from(["arrays", "table"]), st.integers(0, 10**9), st.integers(1, 255))
def test_a_changed_byte_is_noticed_or_changes_nothing(which: str, place: int, flip: int) -> None:
    contents = bytearray(ARRAYS if which == "arrays" else TABLE)
    contents[place % len(contents)] ^= flip
    try:
        got = decode(bytes(contents), TABLE) if which == "arrays" else decode(ARRAYS, bytes(contents))
    except DamagedError:
        return
    assert which == "table"  # some bytes of a table's footer carry nothing
    assert_same(got, trial_result(3, size=20))
