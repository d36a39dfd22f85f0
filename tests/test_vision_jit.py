"""The cache of compiled code never runs yesterday's source, and nothing is compiled twice."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import event
from numba.core.registry import cpu_target

from testbed.vision import _compiling, _jit
from testbed.vision._jit import compiled

CALLEE = """
from testbed.vision._jit import compiled

@compiled
def answer():
    return {}
"""
CALLER = """
from testbed.vision._jit import compiled
from testbed.vision.callee import answer

@compiled
def ask():
    return answer()

print(ask(), sum(ask.stats.cache_hits.values()))
"""


def test_a_change_in_a_called_file_is_noticed(tmp_path: Path) -> None:
    vision, student = tmp_path / "testbed" / "vision", tmp_path / "testbed" / "student"
    vision.mkdir(parents=True)
    student.mkdir()
    for package in (tmp_path / "testbed", vision, student):
        (package / "__init__.py").touch()
    for source in (_jit, _compiling):
        shutil.copy(str(source.__file__), vision)
    (student / "_caller.py").write_text(CALLER)

    def start(value: int) -> subprocess.Popen[str]:
        (vision / "callee.py").write_text(CALLEE.format(value))
        command = [sys.executable, "-B", "-m", "testbed.student._caller"]
        return subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)

    both = [start(1), start(1)]
    assert sorted(each.communicate()[0].strip() for each in both) == [
        "1 0",
        "1 1",
    ]  # one waited for the other
    assert (
        start(2).communicate()[0].strip() == "2 0"
    )  # numba alone would load the caller's cached code, and answer 1


@compiled
def _inner(x: float, doubled: bool) -> float:
    return 2.0 * x if doubled else x


@compiled
def _outer(x: float) -> float:
    return _inner(x, True) + _inner(x, False)


def test_constants_are_not_compiled_for_apart_and_both_can_be_called_from_python() -> None:
    with event.install_recorder("numba:compile") as recorder:
        assert _outer(1.0) == 3.0
    names = [each.data["dispatcher"].py_func.__name__ for _, each in recorder.buffer if each.is_start]
    assert names.count("_inner") <= 1  # none at all if the cache knows the outer one
    assert not _inner.signatures  # type: ignore[attr-defined]
    assert _inner(3.0, True) == 6.0


def test_only_what_python_calls_becomes_machine_code(monkeypatch: pytest.MonkeyPatch) -> None:
    engine: Any = cpu_target.target_context.codegen()._engine
    made, add_module = [], engine.add_module
    monkeypatch.setattr(engine, "add_module", lambda module: made.append(add_module(module)))
    increment: Any = compiled(lambda x: x + 1.0)
    doubled: Any = numba.njit(lambda x: 2.0 * increment(x))
    with _compiling.thrifty():
        assert doubled(1.0) == 4.0
    assert len(made) == 1
