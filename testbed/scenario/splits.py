"""Splits: the same experiment on other teachers and other chances, so that nothing is tuned on what it is judged by.

::

    seed: 7
    splits:
      held_out: {seed: 100003, teachers: {all: {gait: {kind: random}}}}

The file itself is the split ``development``, or what ``split:`` calls it, and is what runs if nobody asks for another.
A split says what it has otherwise, as a cell does, and has a seed of its own: with equal seeds two splits would have
the same students, teachers and noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from testbed.document_errors import mistake
from testbed.scenario.base import LARGEST_SEED

DEVELOPMENT = "development"
"""What the file itself is called where it has splits and does not say."""

_NOT_OF_A_SPLIT = ("name", "cells", "sweep", "split", "splits", "variation")


def check_splits(own: str | None, seed: int, splits: Mapping[str, Mapping[str, Any]]) -> None:
    """See that no two splits share a seed, and that each may say what it says.

    Args:
        own: What the file itself is called.
        seed: The file's seed.
        splits: The others.

    Raises:
        PydanticCustomError: For the first mistake.
    """
    seeds: dict[int, str] = {seed: own or DEVELOPMENT}
    for name, changes in splits.items():
        at = f"splits.{name}"
        if name == own:
            what = f"the file itself is the split '{name}'"
            raise mistake(what, f"call it otherwise with 'split:', or leave '{name}' out", at=at)
        for key in _NOT_OF_A_SPLIT:
            if key in changes:
                what = f"split '{name}' cannot have a {key} of its own"
                raise mistake(what, "all splits share it; say it outside of 'splits:'", at=f"{at}.{key}")
        other = changes.get("seed")
        if other is None:
            raise mistake(f"split '{name}' has no seed of its own", "add e.g. 'seed: 100003'", at=at)
        if not isinstance(other, int) or isinstance(other, bool) or not 0 <= other <= LARGEST_SEED:
            what = f"split '{name}' has no usable seed"
            raise mistake(what, f"write a whole number from 0 to {LARGEST_SEED}", at=f"{at}.seed")
        if other in seeds:
            what = f"splits '{seeds[other]}' and '{name}' have the same seed, {other}"
            mend = "give each its own: with one seed they are the same students and teachers"
            raise mistake(what, mend, at=f"{at}.seed")
        seeds[other] = name
