"""Sweeps on a Ray cluster: real nodes, one of them killed in the middle."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from light_sweep import light, light_sweep

from testbed.errors import UserError
from testbed.experiment.ray_executor import RayExecutor
from testbed.experiment.runner import run

HERE = Path(__file__).parent

# Ray keeps much in its process: each scene has one of its own.
KILLED_NODE = """
    import sys, time
    from pathlib import Path

    from ray.cluster_utils import Cluster
    import ray

    from light_sweep import light_sweep, slow
    from testbed.experiment.ray_executor import RayExecutor
    from testbed.experiment.runner import Quiet, run

    class Killer(Quiet):
        def __init__(self, cluster, victim):
            self.finished_ones, self.cluster, self.victim = 0, cluster, victim

        def finished(self, job):
            self.finished_ones += 1
            if self.finished_ones == 30:
                self.cluster.remove_node(self.victim, allow_graceful=False)  # SIGKILL to its raylet

    # Ray asks every three seconds whether a node lives, and takes the fifth silence for its death.
    impatient = {"health_check_initial_delay_ms": 1000, "health_check_period_ms": 300}
    head = {"num_cpus": 0, "include_dashboard": False, "_system_config": impatient}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
    cluster.wait_for_nodes()
    killer = Killer(cluster, nodes[0])
    outcome = run(light_sweep(), out=Path(sys.argv[1]), executor=RayExecutor(None, cluster.address),
                  display=killer, compute=slow)
    assert not outcome.failed, outcome.failed
    assert killer.finished_ones == 200, killer.finished_ones
    ray.init(address=cluster.address, log_to_driver=False)
    patience = time.monotonic() + 60  # the head declares a node dead after some missed health checks
    while (alive := sum(node["Alive"] for node in ray.nodes())) != 2 and time.monotonic() < patience:
        time.sleep(0.2)
    print("alive", alive)
    ray.shutdown()
    cluster.shutdown()
"""

ALONE = """
    import sys
    from pathlib import Path

    from light_sweep import broken_in_places, light_sweep
    from testbed.experiment.ray_executor import RayExecutor
    from testbed.experiment.runner import run

    outcome = run(light_sweep(3, 2), out=Path(sys.argv[1]), executor=RayExecutor(2), compute=broken_in_places)
    print(sorted(job.cell for job in outcome.failed))
    print((Path(sys.argv[1]) / "trials" / outcome.failed[0].cell / "0.error.txt").read_text())
"""


def _ray(script: str, *arguments: str) -> str:
    path = os.pathsep.join([str(HERE.parent), str(HERE), os.environ.get("PYTHONPATH", "")])
    environment = {
        **os.environ,
        "PYTHONPATH": path,
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # on the loopback
    }
    command = [sys.executable, "-c", textwrap.dedent(script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=500, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_a_node_killed_in_the_middle_loses_nothing(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    said = _ray(KILLED_NODE, str(tmp_path / "ray"))
    assert "alive 2" in said  # the head and one of two
    run(light_sweep(), out=tmp_path / "here", compute=light)
    both = [(tmp_path / where / "verdicts.json").read_bytes() for where in ("ray", "here")]
    assert both[0] == both[1]


def test_what_breaks_in_a_task_comes_home(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    said = _ray(ALONE, str(tmp_path))
    assert "['scale_0.5+camera_noise_1', 'scale_1+camera_noise_1']" in said
    assert "no such luck" in said or "it does not fit" in said


def test_without_ray_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(
        UserError, match=r"needs Ray, which is not installed; pip install 'whom-to-imitate\[ray\]'"
    ):
        run(light_sweep(2, 2), out=tmp_path, executor=RayExecutor(2), compute=light)
