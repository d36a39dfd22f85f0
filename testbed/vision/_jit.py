"""How this project compiles: cached on disk, IEEE arithmetic (no fastmath), no checks for division by zero.

Without fastmath every lane of a vector rounds as a scalar does, so results do not depend on the machine.

What is called from Python is compiled with all that it calls into one piece of machine code, which is kept. Compiled
functions that only others call leave nothing of their own: no entry for Python, no file. That is half of the time.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import types

F = TypeVar("F", bound=Callable[..., Any])
_PACKAGE = Path(__file__).resolve().parents[1]
_ARITHMETIC: dict[str, Any] = {"error_model": "numpy"}
_FOR_PYTHON: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True}
_INSIDE_KNOWN = "0.68."
_CALLED_BY_COMPILED_ALONE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: F) -> F:
    """Compile the function when it is first called, and keep the machine code on disk."""
    # The numpy error model: the Python model's test for zero denominators would keep loops from being vectorised.
    dispatcher: Any = numba.njit(**_FOR_PYTHON, **_ARITHMETIC)(function)
    # numba notices a change of the function's own file, but not of the compiled functions that it calls: without
    # this a loop goes on running yesterday's kernel. Where numba has no such place, its own stamp stays.
    with contextlib.suppress(AttributeError):
        cache_file = dispatcher._cache._cache_file
        cache_file._source_stamp = (cache_file._source_stamp, _sources())
    part: Any = numba.njit(**_ARITHMETIC, **_CALLED_BY_COMPILED_ALONE)(function)
    compile_from_python = dispatcher.compile
    unliteral: Callable[[Any], Any] = types.unliteral

    def compile_thriftily(signature: Any) -> Any:
        with _nobody_else_at_it(dispatcher), _thrifty():
            return compile_from_python(signature)

    def template_for_compiled_callers(arguments: Any, keywords: Any) -> Any:
        # A constant is an argument like any other, or all would be compiled again for it.
        return part.get_call_template([unliteral(each) for each in arguments], keywords)

    dispatcher.compile = compile_thriftily
    dispatcher.get_call_template = template_for_compiled_callers
    dispatcher.get_overload = part.get_overload
    return cast("F", dispatcher)


def is_kept(function: Callable[..., Any]) -> bool:
    """Whether machine code of the function as it is now is on the disk; where numba does not tell, it is."""
    with contextlib.suppress(AttributeError):
        return bool(cast("Any", function)._cache._cache_file._load_index())
    return True


def _thrifty() -> contextlib.AbstractContextManager[None]:
    if not numba.__version__.startswith(_INSIDE_KNOWN):
        return contextlib.nullcontext()
    from testbed.vision._compiling import thrifty  # not before numba is at work

    return thrifty()


@contextlib.contextmanager
def _nobody_else_at_it(dispatcher: Any) -> Iterator[None]:
    """Of several processes that want a function one compiles it; the others wait, and find it on the disk."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(AttributeError, OSError):
            lock = Path(dispatcher._cache._cache_file._index_path).with_suffix(".lock")
            lock.parent.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context(lock.open("w")), fcntl.LOCK_EX)  # until it is closed
        yield


@functools.cache
def _sources() -> str:
    """A digest of every file that holds compiled code."""
    files = sorted([*_PACKAGE.glob("vision/*.py"), *_PACKAGE.glob("student/*/_*.py")])
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
