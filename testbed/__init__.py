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
    from testbed.world.focal import FocalWorld

__version__ = "0.1.0"


def parallel_env(scenario: Scenario | Path | str = "whom_to_imitate", **options: Any) -> World:
    """The world of a scenario as a PettingZoo parallel environment.

    Args:
        scenario: A scenario, the path of its file, or the name of a shipped one.
        options: ``render_mode``, ``max_cycles``, ``images`` and ``backend``, see :class:`testbed.world.env.World`.

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


def focal_env(
    scenario: Scenario | Path | str = "whom_to_imitate",
    *,
    hold: int = 1,
    **options: Any,
) -> FocalWorld:
    """The same world for one agent: a Gymnasium environment of the student, its teachers played by their gaits.

    Args:
        scenario: As for :func:`parallel_env`.
        hold: See :class:`testbed.world.focal.FocalWorld`.
        options: As for :func:`parallel_env`.

    Raises:
        testbed.errors.UserError: If the scenario cannot be used.
    """
    from testbed.world.focal import FocalWorld

    return FocalWorld(parallel_env(scenario, **options), hold=hold)


def register() -> None:
    """Make the world known to ``pettingzoo.make`` and ``gymnasium.make`` as ``testbed/whom_to_imitate-v0``."""
    import gymnasium
    from pettingzoo.env_registry.registration import aec_registry, parallel_registry
    from pettingzoo.env_registry.registration import register as enter

    name = "testbed/whom_to_imitate-v0"
    if name not in parallel_registry:
        enter("parallel", name, parallel_env)
    if name not in aec_registry:
        enter("aec", name, env)
    if name not in gymnasium.registry:
        gymnasium.register(name, focal_env)
