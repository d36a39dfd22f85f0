"""What a real run hands out: exactly the documented columns, and episodes that Minari loads as they were lived."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testbed import cli
from testbed.errors import UserError
from testbed.experiment import runner
from testbed.experiment.columns import SELVES, VERDICTS
from testbed.experiment.jobs import Job
from testbed.experiment.minari_export import export
from testbed.experiment.query import ask
from testbed.experiment.relive import ACTIONS, Episode, relive
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial_files import decode, encode
from testbed.scenario import load_scenario, with_overrides

JOB = Job("default", 0)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A life of `like_me` with the paper's student beside it, cut down to seconds, and fewer and coarser pictures."""
    path = tmp_path_factory.mktemp("runs") / "real"
    scenario = with_overrides(load_scenario("whom_to_imitate"), smoke=True)
    rig = scenario.rig.model_copy(update={"camera_rate": 5.0, "supersample": 1})
    runner.run(scenario.model_copy(update={"rig": rig}), out=path)
    return path


@pytest.fixture(scope="module")
def episode(run: Path) -> Episode:
    """The same life, lived again."""
    return relive(RunDirectory.open(run), JOB)


@pytest.fixture
def loaded(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    (written,) = export(run, tmp_path)
    assert list(minari.list_local_datasets()) == [written.name]
    return minari.load_dataset(written.name)


def test_real_rows_have_exactly_the_documented_columns(run: Path) -> None:
    rows = RunDirectory.open(run).read_rows(JOB)
    # Every row of the file has every column; those of the other kind are empty in it.
    present = {name for row in rows for name in row} - {"kind"}
    documented = {each.name for each in (*VERDICTS, *SELVES)} - {"run"}
    assert present == documented
    for kind, columns in (("verdict", VERDICTS), ("self", SELVES)):
        filled = {
            name for row in rows if row["kind"] == kind for name, value in row.items() if value is not None
        }
        assert filled - {"kind"} <= {each.name for each in columns}
    for table, columns in (("verdicts", VERDICTS), ("selves", SELVES)):
        assert ask([run], f"FROM {table}").names == tuple(each.name for each in columns)


def test_every_student_judges_every_teacher(run: Path) -> None:
    told = json.loads((run / "verdicts.json").read_text())
    assert [row["student"] for row in told["verdicts"]] == ["like_me", "like_me", "paper", "paper"]
    assert [row["student"] for row in told["selves"]] == ["like_me", "paper"]


def test_an_answer_is_what_verdicts_json_says(run: Path) -> None:
    told = json.loads((run / "verdicts.json").read_text())["verdicts"]
    found = ask(
        [run], "SELECT student, teacher, score, verdict, truth FROM verdicts ORDER BY student, teacher"
    ).rows
    for row, (student, teacher, score, *words) in zip(told, found, strict=True):
        assert (row["student"], row["teacher"], row["verdict"], row["truth"]) == (student, teacher, *words)
        assert score == pytest.approx(row["score"], rel=1e-8)


def test_a_trial_is_lived_again_bit_for_bit(run: Path, episode: Episode) -> None:
    recorded = np.load(run / "trials" / "default" / "0.npz")
    steps = len(recorded[ACTIONS])
    assert len(episode.rewards) == steps == len(recorded["truth/student/base"]) - 1
    np.testing.assert_array_equal(
        episode.observations["joints"][1:], recorded[ACTIONS][:, :-1].astype(np.float32)
    )
    for teacher in ("teacher_0", "teacher_1"):  # the very images that the student was judged by
        for look, pair in zip(recorded[f"{teacher}/look_steps"], recorded[f"{teacher}/images"], strict=True):
            for side, image in zip(("left", "right"), pair, strict=True):
                np.testing.assert_array_equal(episode.observations[side][look - 1], image)
    base = recorded["truth/student/base"]
    assert np.abs(episode.rewards.sum()) <= np.linalg.norm(base[-1, :2] - base[0, :2]) + 1e-9


def test_minari_loads_what_was_lived(episode: Episode, loaded: Any) -> None:
    assert loaded.total_episodes == 1
    assert loaded.total_steps == len(episode.actions)
    (back,) = loaded.iterate_episodes()
    assert set(back.observations) == {"tilt", "joints", "left", "right"}
    for sense, values in episode.observations.items():
        np.testing.assert_array_equal(back.observations[sense], values)
        assert back.observations[sense].dtype == values.dtype
        assert loaded.observation_space[sense].contains(back.observations[sense][-1])
    np.testing.assert_array_equal(back.actions, episode.actions.astype(np.float32))
    assert loaded.action_space.contains(back.actions[0])
    np.testing.assert_array_equal(back.rewards, episode.rewards)
    assert not back.terminations.any()
    assert back.truncations.tolist() == [False] * (len(back) - 1) + [True]
    about = next(iter(loaded.storage.get_episode_metadata([0])))
    assert (about["options"]["cell"], about["options"]["trial"], about["seed"]) == (
        "default",
        0,
        episode.seed,
    )


def test_exporting_again_replaces_and_can_leave_images_out(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    for _ in range(2):
        status = cli._status(cli.app, ["export", str(run), "--out", str(tmp_path), "--no-images", "--json"])
        told = json.loads(capsys.readouterr().out)
        assert status == 0
        (data_set,) = told["data_sets"]
        loaded = minari.load_dataset(data_set["name"])
        assert (loaded.total_episodes, loaded.total_steps) == (1, data_set["steps"])
        assert set(next(loaded.iterate_episodes()).observations) == {"tilt", "joints"}
    assert not list(tmp_path.rglob(".data.*"))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("actions", "moves otherwise"),
        ("older", "before actions were recorded"),
        ("damaged", "cannot be read"),
        ("missing", "no finished trial"),
    ],
)
def test_what_cannot_be_lived_again_is_refused(run: Path, tmp_path: Path, change: str, told: str) -> None:
    pytest.importorskip("minari")
    other = tmp_path / "other"
    shutil.copytree(run, other)
    arrays, table = (other / "trials" / "default" / f"0.{ending}" for ending in ("npz", "parquet"))
    result = decode(arrays.read_bytes(), table.read_bytes())
    kept = dict(result.arrays)
    if change == "actions":
        kept[ACTIONS] = kept[ACTIONS] * 0.9
    elif change == "older":
        del kept[ACTIONS]
    files = encode(type(result)(result.rows, kept))
    arrays.write_bytes(files[0] if change != "damaged" else b"rubbish")
    table.write_bytes(files[1])
    if change == "missing":
        table.unlink()
    with pytest.raises(UserError, match=told) as caught:
        export(other, tmp_path / "out", images=False)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "out").rglob("data"))


def test_an_unknown_cell_is_told(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    with pytest.raises(UserError, match="did you mean 'default'"):
        export(run, tmp_path, cell="defualt")
