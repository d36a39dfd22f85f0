"""What a worker does a thousand times leaves nothing behind: Bullet leaks where it is not closed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet
import pytest

from testbed.scenario import load_scenario
from testbed.world.env import World

_WARM, _ROUNDS = 4, 20
_MOST = 2048  # kB after all rounds; one world that is not closed is 29,000
_SCENARIO = """
description: A world that is soon over.
student: {method: random, damage: {limb_lost: limb_b, at: 0.05}}
teachers: [{robot: splayed, gait: still, distance: 0.9, bearing_deg: -30}]
rig: {renderer: RENDERER}
"""


def resident() -> int:
    """What this process holds in memory, kB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4


def clients() -> int:
    """How many Bullet worlds are open."""
    return sum(pybullet.isConnected(client) for client in range(64))


@pytest.mark.parametrize("renderer", ["analytic", "tinyrenderer"])
def test_worlds_that_are_over_take_no_memory(renderer: str, tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(_SCENARIO.replace("RENDERER", renderer))
    scenario, open_before, held = load_scenario(str(tmp_path / "short.yaml")), clients(), []
    for trial in range(_WARM + _ROUNDS):
        world = World(scenario, max_cycles=6)
        world.reset(seed=trial)
        while world.agents:
            world.step({name: np.zeros(world.action_space(name).shape) for name in world.agents})
        world.close()
        held.append(resident())
    assert clients() == open_before
    assert held[-1] - held[_WARM - 1] < _MOST, held
