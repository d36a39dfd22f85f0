"""What the tests share."""

from __future__ import annotations

import pytest

from testbed.scenario import Scenario, load_scenario, with_overrides


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """The shipped scenario with one teacher of each kind."""
    return load_scenario("whom_to_imitate")


@pytest.fixture(scope="session")
def hasty() -> Scenario:
    """The paper's student with the same teachers, cut down to seconds."""
    return with_overrides(load_scenario("paper"), smoke=True)
