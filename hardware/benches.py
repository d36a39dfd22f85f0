"""The scenario `bench` on as many emulated benches as it has trials, each calibrated by its own hands.

    python hardware/benches.py --trials 6 --seed 7 --out runs/benches
    testbed run bench --seed 7 --trials 6 --out runs/simulation
    testbed report runs/simulation runs/benches

Trial k is lived on bench k + 1: other servos, lenses and mountings. Takes about a minute a trial.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from testbed.experiment.runner import OnBench, run
from testbed.experiment.stage import Stage
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.journal import Journal
from testbed.hardware.operating.calibrating_cameras import calibrate_cameras
from testbed.hardware.operating.calibrating_robots import calibrate_robots_servos, calibrate_robots_tilt
from testbed.hardware.operating.stage import on_emulated_bench, workbench_of
from testbed.hardware.rig.backdrop import FILE
from testbed.scenario import Scenario, drawn, load_scenario, with_overrides


def calibrated(scenario: Scenario, seed: int, folder: Path) -> Path:
    """The folder of a bench's calibrations, made where they are missing."""
    if not (folder / FILE).exists():
        with (
            tempfile.TemporaryDirectory(prefix="bench-") as ports,
            EmulatedBench(scenario, seed=seed, ports=Path(ports)) as bench,
        ):
            place = workbench_of(bench, Path(ports), folder)
            list(calibrate_robots_servos(place))
            list(calibrate_robots_tilt(place))
            sys.stdout.write(f"bench {seed}: {calibrate_cameras(place)}\n")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    scenario = with_overrides(load_scenario("bench"), seed=given.seed, trials=given.trials)

    def opened(here: Scenario, journal: Journal | None) -> Stage:
        assert journal is not None
        seed = 1 + int(journal.path.stem)
        folder = calibrated(
            drawn(scenario, 0), seed, given.out.absolute().with_suffix(".calibrations") / str(seed)
        )
        return on_emulated_bench(folder, seed=seed)(here, journal)

    run(scenario, out=given.out, bench=OnBench(opened))


if __name__ == "__main__":
    main()
