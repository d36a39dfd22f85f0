"""Python looks for garbage after every few hundred new objects; who makes millions of them spends a fifth on that."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator

_RARELY = 20_000  # new objects; Python's own number is 700


@contextlib.contextmanager
def rarely_collected() -> Iterator[None]:
    """While this lasts, garbage is looked for thirty times less often: there is some tens of MB more of it."""
    before = gc.get_threshold()
    gc.set_threshold(_RARELY, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
