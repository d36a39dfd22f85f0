"""Scenario files: read, completed, hashed, checked.

A scenario comes in by path or by the name of a shipped one (:func:`load_scenario`), may be changed from the
command line (:func:`with_overrides`), is written out whole (:func:`resolve`) and named by what it says
(:func:`content_hash`). :func:`check` looks at what only the robots' bodies can tell.

A scenario is run cell by cell and trial by trial: ``drawn(in_cell(scenario, cell), trial)`` is concrete.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testbed.bodies.robot_files import content_of
from testbed.document_writing import document_text
from testbed.documents import Document, parse_document, read_document, validate
from testbed.errors import UserError
from testbed.resources import robot_names, robot_path, scenario_path
from testbed.scenario.bodies import is_path
from testbed.scenario.cells import (
    cell_names,
    in_cell,
    in_split,
    may_be_left_out,
    mind_names,
    probed_cells,
    split_names,
    sweep_of,
    trials_of,
)
from testbed.scenario.check import check, check_trial
from testbed.scenario.drawing import check_ends, drawn
from testbed.scenario.specs import (
    LARGEST_SEED,
    GaitSpec,
    JointWave,
    LightSpec,
    MindSpec,
    RigSpec,
    Scenario,
    StudentSpec,
    TeacherSpec,
    WorldSpec,
)

__all__ = [
    "GaitSpec",
    "JointWave",
    "LightSpec",
    "MindSpec",
    "RigSpec",
    "Scenario",
    "StudentSpec",
    "TeacherSpec",
    "WorldSpec",
    "as_scenario",
    "cell_names",
    "check",
    "check_trial",
    "content_hash",
    "drawn",
    "in_cell",
    "in_split",
    "is_path",
    "load_scenario",
    "may_be_left_out",
    "mind_names",
    "parse_scenario",
    "resolve",
    "split_names",
    "sweep_of",
    "trials_of",
    "with_overrides",
    "with_robot_files",
]

_HASH_LENGTH = 8


def load_scenario(path_or_name: Path | str) -> Scenario:
    """Read a scenario file, or a shipped scenario by its bare name.

    Raises:
        UserError: For any mistake in the file, with its line and how to mend it.
    """
    path = Path(path_or_name)
    bare = isinstance(path_or_name, str) and path.name == path_or_name and not path.suffix
    if bare and not path.is_file():
        path = scenario_path(path.name)
    return _scenario(read_document(path), path)


def as_scenario(scenario: Scenario | Path | str) -> Scenario:
    """A scenario as it is, or read and checked from its path or the name of a shipped one.

    Raises:
        UserError: As :func:`load_scenario` and :func:`check` do.
    """
    if isinstance(scenario, Scenario):
        return scenario
    loaded = load_scenario(scenario)
    check(loaded)
    return loaded


def parse_scenario(text: str, file: Path | str = "scenario.yaml") -> Scenario:
    """A scenario from YAML text; ``file`` names it in errors, and robots are found beside it.

    Raises:
        UserError: As :func:`load_scenario` does.
    """
    return _scenario(parse_document(text, file), Path(file))


def _scenario(document: Document, path: Path) -> Scenario:
    data = {"name": path.stem, **document.data}
    try:
        scenario = validate(Scenario, Document(data, document.source))
    except UserError as error:
        if "name" not in document.data and error.what.startswith("name "):
            what = f"the file's name '{path.stem}' cannot be the scenario's name"
            raise UserError(what, "add a line such as 'name: my_scenario'", file=path, line=1) from None
        raise
    scenario._source = document.source
    for variant in (scenario, *(in_split(scenario, split) for split in scenario.splits)):
        for cell in probed_cells(variant):
            check_ends(in_cell(variant, cell))
    return _with_robots_beside(scenario, path.parent)


def _with_robots_beside(scenario: Scenario, folder: Path) -> Scenario:
    """Paths of robots made absolute, so that they mean the same wherever the scenario goes."""
    return with_robot_files(scenario, lambda robot: str((folder / robot).absolute()))


def with_robot_files(scenario: Scenario, moved: Callable[[str], str]) -> Scenario:
    """The scenario with every path of a robot or recording replaced by ``moved(path)``; shipped robots' names stay."""
    data = scenario.template
    changed = _robots_replaced(data, lambda robot: moved(robot) if is_path(robot) else robot)
    if changed == data:
        return scenario
    with_files = Scenario.model_validate(changed)
    with_files._source = scenario.source
    return with_files


def _robots_replaced(data: Any, replace: Callable[[str], object], *, named: bool = False) -> Any:
    """Plain data with every robot in them replaced, in choices, plans, cells and sweeps too."""
    if isinstance(data, list):
        return [_robots_replaced(value, replace, named=named) for value in data]
    if not isinstance(data, dict):
        return replace(data) if named and isinstance(data, str) else data
    changed = {}
    for key, value in data.items():
        robots = key.rsplit(".", 1)[-1] in ("robot", "parts_of", "file") or (
            named and key in ("choice", "values")
        )
        if robots and key == "values" and isinstance(value, dict):  # of a sweep, by name
            changed[key] = {name: _robots_replaced(one, replace, named=True) for name, one in value.items()}
        else:
            changed[key] = _robots_replaced(value, replace, named=robots)
    return changed


def resolve(scenario: Scenario) -> str:
    """The scenario as YAML text with every default filled in; reading it gives an equal scenario."""
    return document_text(scenario.template)


def content_hash(scenario: Scenario) -> str:
    """Eight hexadecimal digits of what the scenario says, the robots' descriptions included.

    ``trials`` is left out, also that of cells: it is a total, and a run with more of them continues; so are the splits
    but for the one that the scenario is. Comments, the order of keys, spelled-out defaults and the folder that the
    files are in change nothing.
    """
    data = _robots_replaced(scenario.template, _robot_content)
    data.pop("splits", None)  # what else could be run
    for counted in (data, *data.get("cells", {}).values()):
        counted.pop("trials", None)
    text = json.dumps(data, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_LENGTH]


def _robot_content(robot: str) -> object:
    """What a robot's description says, so that a changed body is a changed scenario."""
    if not is_path(robot) and robot not in robot_names():
        return robot  # no such robot: check() says so
    path = Path(robot) if is_path(robot) else robot_path(robot)
    return content_of(path)


def with_overrides(
    scenario: Scenario,
    *,
    split: str | None = None,
    seed: int | None = None,
    trials: int | None = None,
    smoke: bool = False,
) -> Scenario:
    """The scenario with a command line's wishes.

    Args:
        scenario: What the file says.
        split: One of its splits; the scenario as it stands if None.
        seed: Another seed, from 0 to 2**32 - 1.
        trials: Another total number of trials.
        smoke: Cut down to seconds: one trial (unless ``trials`` says otherwise), the student's smallest
            parameters, and of a sweep one value an axis.

    Raises:
        UserError: If a number is out of range, there is no such split, or the seed is another split's.
    """
    others = {changes["seed"]: name for name, changes in scenario.splits.items() if name != split}
    if split is not None:
        others[scenario.seed] = scenario.split or ""
        scenario = in_split(scenario, split)
    update: dict[str, object] = {}
    if smoke:
        student, *beside = (
            mind.model_copy(update={"parameters": mind.parameters.smoke()}) for mind in scenario.minds
        )
        update["student"], update["beside"] = student, tuple(beside)
        update["trials"] = 1
        update["sweep"] = {name: block.smoke() for name, block in scenario.sweep.items()}
    if seed is not None:
        if not 0 <= seed <= LARGEST_SEED:
            raise UserError(f"seed {seed} is out of range", f"choose one between 0 and {LARGEST_SEED}")
        if seed in others and seed != scenario.seed:
            what = f"seed {seed} is that of the split '{others[seed]}'"
            raise UserError(what, f"choose another, or give --split {others[seed]}")
        update["seed"] = seed
    if trials is not None:
        if trials < 1:
            raise UserError(f"{trials} trials are too few", "ask for at least 1; the number is the total")
        update["trials"] = trials
    if "trials" in update:
        update["cells"] = {
            name: {key: value for key, value in cell.items() if key != "trials"}
            for name, cell in scenario.cells.items()
        }
    return scenario.model_copy(update=update)
