"""Where the shipped robots and scenarios are: beside the package in a checkout, inside it in a wheel."""

from __future__ import annotations

from pathlib import Path

from testbed.errors import UserError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent
ROBOT_SUFFIXES = (".yaml",)
SCENARIO_SUFFIXES = (".yaml",)


def data_root() -> Path:
    """The folder that holds ``robots/`` and ``scenarios/``."""
    checkout = _PACKAGE.parent
    # A stray folder named robots/ in site-packages must not win: only a checkout has the project file.
    if (checkout / "pyproject.toml").is_file() and (checkout / "robots").is_dir():
        return checkout
    return _PACKAGE / "_data"


def robot_names() -> tuple[str, ...]:
    """The names of the shipped robots, sorted."""
    return _names("robots", ROBOT_SUFFIXES)


def scenario_names() -> tuple[str, ...]:
    """The names of the shipped scenarios, sorted."""
    return _names("scenarios", SCENARIO_SUFFIXES)


def robot_path(name: str) -> Path:
    """The description of a shipped robot.

    Raises:
        UserError: If no such robot is shipped; the nearest name is the mend.
    """
    return _path("robots", ROBOT_SUFFIXES, name, "robot")


def scenario_path(name: str) -> Path:
    """The file of a shipped scenario.

    Raises:
        UserError: If no such scenario is shipped; the nearest name is the mend.
    """
    return _path("scenarios", SCENARIO_SUFFIXES, name, "scenario")


def _names(folder: str, suffixes: tuple[str, ...]) -> tuple[str, ...]:
    try:
        files = list((data_root() / folder).iterdir())
    except FileNotFoundError:
        return ()
    return tuple(sorted({file.stem for file in files if file.suffix in suffixes}))


def _path(folder: str, suffixes: tuple[str, ...], name: str, kind: str) -> Path:
    known = _names(folder, suffixes)
    if name not in known:
        raise UserError(f"unknown {kind} '{name}'", did_you_mean(name, known, kind=f"{kind}s"))
    candidates = (data_root() / folder / f"{name}{suffix}" for suffix in suffixes)
    return next(path for path in candidates if path.is_file())
