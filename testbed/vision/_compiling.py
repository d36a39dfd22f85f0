"""Machine code for what Python calls, and for nothing else: numba does for every function what only the last needs.

A function that only compiled functions call is needed as LLVM's input to these. numba optimises it all the same,
makes machine code of it and keeps that in memory, and then once more as a part of each caller; and whatever a `+` or
an `x[i]` of the same types gives, it asks ten candidates anew, each time. That is half of the time.
Neither changes what is computed: without fastmath LLVM rounds alike, whatever it inlines and when.

All of this is numba's inside, as of 0.68. Any other numba compiles as it pleases, and takes longer.
"""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Iterator
from typing import Any

from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction

_PLAIN = (types.Number, types.Boolean, types.Array, types.BaseTuple, types.SliceType, types.NoneType)
_Function: Any = BaseFunction
_Library: Any = JITCodeLibrary
_ask = _Function.get_call_type


@contextlib.contextmanager
def thrifty() -> Iterator[None]:
    """While this lasts, numba compiles what is asked for, and looks for no garbage on the way."""
    with global_compiler_lock, _no_garbage_collected(), _answers_remembered(), _ingredients_left_raw():
        yield


@contextlib.contextmanager
def _no_garbage_collected() -> Iterator[None]:
    """Compiling makes millions of small objects that live on; looking for garbage among them takes a fifth of it."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextlib.contextmanager
def _answers_remembered() -> Iterator[None]:
    """What type an operator gives for arguments of these types is found out once."""

    def get_call_type(function: Any, context: Any, arguments: Any, keywords: Any) -> Any:
        if keywords or not all(isinstance(each, _PLAIN) for each in arguments):
            return _ask(function, context, arguments, keywords)
        return _answer(function, context, tuple(arguments))

    _Function.get_call_type = get_call_type
    try:
        yield
    finally:
        _Function.get_call_type = _ask


@functools.cache
def _answer(function: Any, context: Any, arguments: tuple[Any, ...]) -> Any:
    return _ask(function, context, arguments, {})


class _Ingredient(_Library):  # type: ignore[misc]
    """The code of a function, not made into machine code before somebody wants to know where that is."""

    _wanted = False

    def get_pointer_to_function(self, name: str) -> int:
        """Where the function is; 0 if there is none of this name."""
        if not self._wanted:
            with contextlib.suppress(NameError):
                self._wanted = not self._final_module.get_function(name).is_declaration
            if not self._wanted:
                return 0
            self._finalized = False  # as an ingredient it may be complete
        address: int = super().get_pointer_to_function(name)
        return address

    def finalize(self) -> None:
        """Put together what this function consists of; what Python calls is optimised and made into machine code."""
        if self._wanted:
            super().finalize()
            return
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def _finalize_final_module(self) -> None:
        self._wanted = True  # also what comes from the disk
        super()._finalize_final_module()


@contextlib.contextmanager
def _ingredients_left_raw() -> Iterator[None]:
    codegen: Any = cpu_target.target_context.codegen()
    set_environment = codegen.set_env

    def set_if_there(name: str, environment: Any) -> None:
        if codegen._engine.is_symbol_defined(name):
            set_environment(name, environment)

    before = codegen._library_class
    codegen._library_class, codegen.set_env = _Ingredient, set_if_there
    try:
        yield
    finally:
        codegen._library_class, codegen.set_env = before, set_environment
