"""What the tests share."""

from __future__ import annotations

import pytest
from hypothesis import settings

from testbed.scenario import Scenario, load_scenario, with_overrides

settings.register_profile("testbed", deadline=None)  # how long an example takes is the machine's load
settings.load_profile("testbed")

LONGEST = (
    "test_runner",
    "test_report",
    "test_report_minds",
    "test_minds",
    "test_ray_executor",
    "test_report_real",
    "test_shipped_scenarios",
    "test_rediscovery",
    "test_rivals",
    "test_asking_real",
    "test_after_damage",
    "test_executor",
    "test_damage",
    "test_trial",
)
"""Files that take longest. They begin first, so that no worker is left alone with one of them in the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Stable: files of no such length follow in their own order."""
    rank = {f"{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path.name, len(LONGEST)))


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """The shipped scenario with one teacher of each kind."""
    return load_scenario("whom_to_imitate")


@pytest.fixture(scope="session")
def hasty() -> Scenario:
    """The paper's student with the same teachers, cut down to seconds; it takes fewer and coarser pictures."""
    scenario = with_overrides(load_scenario("paper"), smoke=True)
    rig = scenario.rig.model_copy(update={"camera_rate": 5.0, "supersample": 1})
    return scenario.model_copy(update={"rig": rig})
