"""How this project compiles: cached on disk, IEEE arithmetic (no fastmath), no checks for division by zero.

Without fastmath every lane of a vector rounds as a scalar does, so results do not depend on the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])
Decorator = Callable[[F], F]

# error_model="numpy": the Python model's test for zero denominators would keep loops from being vectorised.
compiled = cast("Callable[[F], F]", numba.njit(cache=True, error_model="numpy"))
inlined = cast("Callable[[F], F]", numba.njit(cache=True, error_model="numpy", inline="always"))
