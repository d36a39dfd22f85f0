"""How this project compiles: cached on disk, IEEE arithmetic (no fastmath), no checks for division by zero.

Without fastmath every lane of a vector rounds as a scalar does, so results do not depend on the machine.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])
_PACKAGE = Path(__file__).resolve().parents[1]


def compiled(function: F) -> F:
    """Compile the function when it is first called, and keep the machine code on disk."""
    # error_model="numpy": the Python model's test for zero denominators would keep loops from being vectorised.
    dispatcher: Any = numba.njit(cache=True, error_model="numpy")(function)
    # numba notices a change of the function's own file, but not of the compiled functions that it calls: without
    # this a loop goes on running yesterday's kernel. Where numba has no such place, its own stamp stays.
    with contextlib.suppress(AttributeError):
        cache_file = dispatcher._cache._cache_file
        cache_file._source_stamp = (cache_file._source_stamp, _sources())
    return cast("F", dispatcher)


@functools.cache
def _sources() -> str:
    """A digest of every file that holds compiled code."""
    files = sorted([*_PACKAGE.glob("vision/*.py"), *_PACKAGE.glob("student/*/_*.py")])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
