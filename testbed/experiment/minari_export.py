"""Episodes of a run as Minari data sets: what the student saw, did and gained, for offline learners.

A data set holds the trials of one cell, one episode each, bit for bit as they were lived (images without loss). Its
name is ``testbed/<scenario>-<hash>/<cell>-v0``. Minari knows episodes of one agent with one action space; so the
teachers are part of the world, and every trial of a cell must have a student with the same joints.
"""

from __future__ import annotations

import functools
import re
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import testbed
from testbed.errors import UserError, did_you_mean, shown_path
from testbed.experiment.atomic import refused_writes_explained
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.relive import Episode, relive
from testbed.experiment.run_directory import RunDirectory
from testbed.scenario import in_cell


class DataSet(NamedTuple):
    """A data set that was written.

    Attributes:
        name: What ``minari.load_dataset`` calls it.
        folder: Where it is.
        episodes: How many.
        steps: Actions in all of them.
    """

    name: str
    folder: Path
    episodes: int
    steps: int


def export(
    folder: Path,
    out: Path,
    *,
    cell: str | None = None,
    images: bool = True,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[DataSet]:
    """Write the finished trials of a run as Minari data sets, in place of earlier ones.

    Args:
        folder: The run directory.
        out: Minari's folder of data sets: what ``MINARI_DATASETS_PATH`` names.
        cell: The only cell to export; all of them if it is None.
        images: Whether the images are among the observations: 15 kB a step.
        progress: Told how many trials are done.

    Raises:
        UserError: If Minari is missing, the run has no such trials, one does not come out as it did, or the place
            cannot be written.
    """
    _require_minari()
    run = RunDirectory.open(folder)
    by_cell: dict[str, list[Job]] = {}
    known = dict.fromkeys(job.cell for job in jobs_of(run.scenario))
    if cell is not None and cell not in known:
        raise UserError(f"there is no cell '{cell}'", did_you_mean(cell, known, kind="cells"))
    for job in jobs_of(run.scenario):
        if run.is_finished(job) and cell in (None, job.cell):
            by_cell.setdefault(job.cell, []).append(job)
    if not by_cell:
        raise UserError(f"{shown_path(folder)} has no finished trial yet", "run its scenario first")
    names = {each: data_set_name(run, each) for each in by_cell}
    total, done, written = sum(map(len, by_cell.values())), 0, []
    for each, jobs in by_cell.items():
        with refused_writes_explained(out):
            target = out / names[each]
            target.mkdir(parents=True, exist_ok=True)
            temporary = Path(tempfile.mkdtemp(prefix=".data.", dir=target))
        try:
            with refused_writes_explained(target):
                steps = _write(
                    run, jobs, names[each], temporary, images, functools.partial(_move, progress, done, total)
                )
                shutil.rmtree(target / "data", ignore_errors=True)
                temporary.replace(target / "data")
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        done += len(jobs)
        written.append(DataSet(names[each], target, len(jobs), steps))
    return written


def _move(progress: Callable[[int, int], None], before: int, total: int, number: int) -> None:
    progress(before + number, total)


def data_set_name(run: RunDirectory, cell: str) -> str:
    """What Minari calls the data set of a cell: letters, digits, ``_`` and ``-`` alone."""
    scenario, kept = (re.sub(r"[^\w-]", "_", name) for name in (run.scenario.name, cell))
    return f"testbed/{scenario}-{run.hash8}/{kept}-v0"


def _write(
    run: RunDirectory,
    jobs: Sequence[Job],
    name: str,
    folder: Path,
    images: bool,
    progress: Callable[[int], None],
) -> int:
    """Write the data set into an empty folder, an episode at a time; returns its number of steps."""
    from minari.dataset.minari_storage import MinariStorage

    storage, first, steps = None, None, 0
    for number, job in enumerate(jobs):
        progress(number)
        episode = relive(run, job, images=images)
        if storage is None or first is None:
            first = episode
            storage = MinariStorage.new(
                folder, episode.observation_space, episode.action_space, jpeg_encoding=False
            )
            storage.update_metadata(_about(run, job.cell, name))
        elif (episode.observation_space, episode.action_space) != (
            first.observation_space,
            first.action_space,
        ):
            raise UserError(
                f"the student of {job} has other joints than that of {jobs[0]}, and a data set has one action space",
                "choose a cell in which its body is the same, with --cell",
            )
        storage.update_episodes([_buffer(number, job, episode)])
        steps += len(episode.actions)
    progress(len(jobs))
    return steps


def _buffer(number: int, job: Job, episode: Episode) -> Any:
    from minari.data_collector import EpisodeBuffer

    space, steps = episode.action_space, len(episode.actions)
    last = np.arange(steps) == steps - 1  # the student was done; the world would have gone on
    return EpisodeBuffer(
        id=number,
        seed=episode.seed,
        options={"cell": job.cell, "trial": job.trial},
        observations=episode.observations,
        actions=np.clip(episode.actions, space.low, space.high).astype(space.dtype),
        rewards=episode.rewards,
        terminations=np.zeros(steps, bool),
        truncations=last,
    )


def _about(run: RunDirectory, cell: str, name: str) -> dict[str, Any]:
    import minari

    here = in_cell(run.scenario, cell)
    return {
        "dataset_id": name,
        "minari_version": minari.__version__,
        "algorithm_name": here.minds[0].name,
        "description": f"{here.name}, cell {cell}: {here.description or 'lives of a student among teachers'}",
        "requirements": [f"whom-to-imitate=={testbed.__version__}"],
    }


def _require_minari() -> None:
    try:
        import h5py  # noqa: F401
        import minari  # noqa: F401
    except ImportError as error:
        mend = "install them: pip install 'whom-to-imitate[minari]'"
        raise UserError("exporting episodes needs Minari and h5py", mend) from error
