"""Whom to imitate: a testbed in which a robot finds out who is worth learning from.

>>> import testbed
>>> world = testbed.parallel_env("whom_to_imitate")
>>> observations, infos = world.reset(seed=1)
>>> sorted(observations)
['student', 'teacher_0', 'teacher_1']
>>> world.close()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from pettingzoo import AECEnv

    from testbed.scenario import Scenario
    from testbed.world.env import World

__version__ = "0.1.0"


def parallel_env(scenario: Scenario | Path | str = "whom_to_imitate", **options: Any) -> World:
    """The world of a scenario as a PettingZoo parallel environment.

    Args:
        scenario: A scenario, the path of its file, or the name of a shipped one.
        options: ``render_mode`` and ``backend``, see :class:`testbed.world.env.World`.

    Raises:
        testbed.errors.UserError: If the scenario cannot be used.
    """
    from testbed.scenario import as_scenario
    from testbed.world.env import World

    return World(as_scenario(scenario), **options)


def env(scenario: Scenario | Path | str = "whom_to_imitate", **options: Any) -> AECEnv[str, Any, Any]:
    """The same world as an AEC environment, by PettingZoo's own conversion."""
    from pettingzoo.utils.conversions import parallel_to_aec
    from pettingzoo.utils.wrappers import OrderEnforcingWrapper

    return OrderEnforcingWrapper(parallel_to_aec(parallel_env(scenario, **options)))


def register() -> None:
    """Make the world known to ``pettingzoo.make`` as ``testbed/whom_to_imitate-v0``."""
    from pettingzoo import register as enter

    enter("parallel", "testbed/whom_to_imitate-v0", parallel_env)
    enter("aec", "testbed/whom_to_imitate-v0", env)
