"""Questions to runs: the right rows, nothing but the tables, damage named, many trials quick."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from trial_builder import compute, scenario_of, trial_result

from testbed import cli
from testbed.errors import UserError
from testbed.experiment import runner, tables
from testbed.experiment.columns import SELVES, TABLES, VERDICTS, as_markdown, listed
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.query import Answer, ask
from testbed.experiment.record import TrialResult
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.runner import summed_up
from testbed.experiment.trial_files import _FLAGS, _TEXT, _WHOLE, encode

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "whom-1a2b3c4d"
    runner.run(scenario_of(6), out=path, compute=compute)
    return path


def answer(run: Path, sql: str) -> list[tuple[Any, ...]]:
    return list(ask([run], sql).rows)


def copied(run: Path, folder: Path) -> Path:
    for file in [each for each in run.rglob("*") if each.is_file()]:
        target = folder / file.relative_to(run)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.read_bytes())
    return folder


def test_an_answer_is_what_the_trials_hold(run: Path) -> None:
    rows = [row for trial in range(6) for row in trial_result(trial).rows]
    expected = sorted((row["trial"], row["teacher"], row["score"], row["found"]) for row in rows)
    got = answer(run, "SELECT trial, teacher, score, found FROM verdicts ORDER BY ALL")
    assert got == expected
    right = sum(row["verdict"] == row["truth"] for row in rows)
    assert answer(run, "SELECT count(*) FILTER (verdict = truth) FROM verdicts") == [(right,)]
    assert answer(run, "FROM selves") == []
    assert answer(run, "SELECT DISTINCT run, scenario, seed, state, why FROM trials") == [
        ("whom-1a2b3c4d", "whom_to_imitate", 5, "finished", None)
    ]


def test_every_documented_column_is_there_in_order_and_of_its_kind(run: Path) -> None:
    kinds = {"text": "VARCHAR", "whole": "BIGINT", "number": "DOUBLE", "flag": "BOOLEAN"}
    for table, columns in TABLES.items():
        described = answer(run, f"SELECT column_name, column_type FROM (DESCRIBE {table})")
        assert described[: len(columns)] == [(each.name, kinds[each.kind]) for each in columns]


def test_columns_are_documented_once_with_words_for_each() -> None:
    for columns in TABLES.values():
        names = [each.name for each in columns]
        assert len(set(names)) == len(names)
        assert all(each.meaning and each.meaning[-1] not in ".;" for each in columns)
        assert all(each.unit == "deg" for each in columns if each.name.endswith("_deg"))
        assert not any(each.unit for each in columns if each.kind in ("text", "flag"))
    assert len(list(listed())) == sum(map(len, TABLES.values()))


def test_files_have_the_types_that_are_documented() -> None:
    kinds = {each.name: each.kind for each in (*VERDICTS, *SELVES)}
    assert all(kinds.get(name, "text") == "text" for name in _TEXT)
    assert all(kinds.get(name, "whole") == "whole" for name in _WHOLE)
    assert all(kinds.get(name, "flag") == "flag" for name in _FLAGS)
    assert {name for name, kind in kinds.items() if kind == "flag"} <= set(_FLAGS)
    assert {name for name, kind in kinds.items() if kind == "text"} <= {*_TEXT, "run"}


def test_the_documentation_has_every_column() -> None:
    assert as_markdown() in (ROOT / "docs" / "results.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("sql", "told"),
    [
        ("SELECT scre FROM verdicts", "there is no column 'scre'; did you mean 'score'?"),
        ('SELECT * FROM verdicts WHERE truth = "appropriate"', "'single quotes'"),
        ("SELECT * FROM verdict", "there is no table 'verdict'; did you mean 'verdicts'?"),
        ("SELEC score FROM verdicts", 'syntax error at or near "SELEC"'),
        ("SELECT sum(truth) FROM verdicts", "sum(VARCHAR)"),
        ("SELECT score FROM verdicts WHERE", "syntax error"),
        ("SELECT cast(truth AS INT) FROM verdicts", "Could not convert"),
        ("  ", "the query is empty"),
        ("SELECT 1; DROP TABLE verdicts", "2 queries"),
        ("DELETE FROM verdicts", "a run is only read"),
        ("CREATE TABLE more AS FROM verdicts", "a run is only read"),
        ("SET enable_external_access = true", "a run is only read"),
        ("PRAGMA enable_profiling", "a run is only read"),
        ("INSTALL httpfs", "a run is only read"),
        ("LOAD httpfs", "a run is only read"),
        ("ATTACH 'x.db'", "a run is only read"),
        ("CALL pragma_version()", "a run is only read"),
    ],
)
def test_a_mistake_is_one_line_with_a_mend(run: Path, sql: str, told: str) -> None:
    with pytest.raises(UserError) as caught:
        ask([run], sql)
    assert told in str(caught.value)
    assert "; " in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_a_query_reads_and_writes_no_file(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    secret = tmp_path / "secret.csv"
    secret.write_text("word\nplaice\n")
    parquet = next(run.rglob("*.parquet"))
    before = sorted(tmp_path.rglob("*"))
    for sql in (
        f"FROM read_csv('{secret}')",
        f"FROM read_text('{secret}')",
        f"FROM read_blob('{secret}')",
        f"FROM '{secret}'",
        f"FROM '{parquet}'",
        f"FROM parquet_metadata('{parquet}')",
        f"FROM glob('{tmp_path}/*')",
        f"FROM sniff_csv('{secret}')",
        f"COPY verdicts TO '{tmp_path}/out.csv'",
        f"EXPORT DATABASE '{tmp_path}/out'",
        f"SELECT * FROM sqlite_scan('{tmp_path}/x.db', 't')",
        "FROM arriving",  # what a table was called on its way
        "FROM secret",  # a variable of this process
        "SELECT getenv('HOME')",
    ):
        with pytest.raises(UserError):
            ask([run], sql)
    assert sorted(tmp_path.rglob("*")) == before


def test_several_runs_are_told_apart_by_their_last_folders(run: Path, tmp_path: Path) -> None:
    twin = copied(run, tmp_path / "elsewhere" / run.name)
    got = ask([run, twin], "SELECT run, count(*) FROM verdicts GROUP BY run ORDER BY run").rows
    assert got == tuple(sorted([(f"{run.parent.name}/{run.name}", 12), (f"elsewhere/{run.name}", 12)]))
    with pytest.raises(UserError, match="given twice"):
        ask([run, run], "FROM trials")
    with pytest.raises(UserError, match="no run directory"):
        ask([run, tmp_path], "FROM trials")


def test_what_is_damaged_failed_or_missing_is_named_and_left_out(run: Path, tmp_path: Path) -> None:
    broken = copied(run, tmp_path / "broken")
    folder = broken / "trials" / "default"
    contents = bytearray((folder / "1.parquet").read_bytes())
    contents[len(contents) // 3] ^= 1
    (folder / "1.parquet").write_bytes(contents)
    (folder / "2.parquet").write_bytes((folder / "2.parquet").read_bytes()[:-100])
    (folder / "3.parquet").unlink()
    (folder / "4.parquet").unlink()
    (folder / "4.error.txt").write_text("Traceback\nRuntimeError: servo on fire\n")
    found = ask([broken], "SELECT trial, state, why FROM trials ORDER BY trial")
    assert [row[:2] for row in found.rows] == [
        (0, "finished"), (1, "damaged"), (2, "damaged"), (3, "missing"), (4, "failed"), (5, "finished"),
    ]  # fmt: skip
    assert found.rows[4][2] == "RuntimeError: servo on fire"
    assert [damage.job.trial for damage in found.damaged] == [1, 2]
    assert str(found.damaged[0]).startswith("trial 1 of broken is damaged (the table")
    assert answer(broken, "SELECT DISTINCT trial FROM verdicts ORDER BY trial") == [(0,), (5,)]


def test_columns_that_nobody_documented_can_be_asked_too(tmp_path: Path) -> None:
    def with_more(job: Job, progress: Progress) -> TrialResult:
        result = trial_result(job.trial)
        rows = tuple({**row, "regret": 0.5, "mood": "gay" if job.trial else None} for row in result.rows)
        return TrialResult(rows, result.arrays)

    runner.run(scenario_of(2), out=tmp_path / "r", compute=with_more)
    assert answer(tmp_path / "r", "SELECT max(regret), max(mood) FROM verdicts") == [(0.5, "gay")]


@pytest.fixture
def few_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "MANY", 3)


@pytest.mark.usefixtures("few_are_many")
def test_rows_kept_together_are_the_same_and_follow_the_files(run: Path, tmp_path: Path) -> None:
    big = copied(run, tmp_path / "big")
    everything = "SELECT * EXCLUDE (run) FROM verdicts ORDER BY ALL"
    before = answer(run, everything)
    assert answer(big, everything) == before
    assert (big / tables.KEPT).is_file()
    read: list[Path] = []
    original = tables._contents
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "_contents", lambda path: (read.append(path), original(path))[1])
        assert answer(big, everything) == before
        assert read == []
        folder = big / "trials" / "default"
        _, other = encode(TrialResult(tuple({**r, "robot": "new"} for r in trial_result(2).rows), {}))
        (folder / "2.parquet").write_bytes(other)
        (folder / "5.parquet").unlink()
        after = answer(big, "SELECT trial, robot FROM verdicts WHERE trial IN (2, 5) ORDER BY ALL")
        assert after == [(2, "new"), (2, "new")]
        assert [path.name for path in read] == ["2.parquet"]


@pytest.mark.usefixtures("few_are_many")
def test_a_run_keeps_its_rows_for_the_first_question(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    big = copied(run, tmp_path / "big")
    directory = RunDirectory.open(big)
    jobs = jobs_of(directory.scenario)
    (big / tables.KEPT).unlink(missing_ok=True)  # of another test
    summed_up(directory)
    assert (big / tables.KEPT).is_file()
    (big / tables.KEPT).unlink()
    tables.keep(directory, jobs[:2], [])
    assert not (big / tables.KEPT).exists()  # two are not many
    tables.keep(directory, jobs, [row for job in jobs for row in directory.read_rows(job)])
    everything = "SELECT * EXCLUDE (run) FROM verdicts ORDER BY ALL"
    before = answer(run, everything)
    written = (big / tables.KEPT).stat().st_mtime_ns
    tables.keep(directory, jobs, [])  # it is fresh
    assert (big / tables.KEPT).stat().st_mtime_ns == written
    with monkeypatch.context() as patch:
        patch.setattr(tables, "_contents", lambda path: pytest.fail(f"{path} was read"))
        assert answer(big, everything) == before
    (big / "trials" / "default" / "3.parquet").write_bytes(b"rubbish")  # stale now
    assert [damage.job.trial for damage in ask([big], everything).damaged] == [3]


@pytest.mark.usefixtures("few_are_many")
def test_a_copy_that_is_rubbish_or_cannot_be_written_does_no_harm(run: Path, tmp_path: Path) -> None:
    big = copied(run, tmp_path / "big")
    before = answer(run, "SELECT sum(score) FROM verdicts")
    for rubbish in (b"", b"PAR1", b"rubbish" * 100):
        (big / tables.KEPT).write_bytes(rubbish)
        assert answer(big, "SELECT sum(score) FROM verdicts") == before
    assert pq.read_table(big / tables.KEPT).num_rows == 12
    (big / tables.KEPT).unlink()
    (big / tables.KEPT).mkdir()
    assert answer(big, "SELECT sum(score) FROM verdicts") == before


@pytest.mark.usefixtures("few_are_many")
def test_a_damaged_trial_is_not_kept(run: Path, tmp_path: Path) -> None:
    big = copied(run, tmp_path / "big")
    (big / "trials" / "default" / "0.parquet").write_bytes(b"rubbish")
    for _ in range(2):
        assert [damage.job.trial for damage in ask([big], "FROM trials").damaged] == [0]


values = st.one_of(st.none(), st.booleans(), st.integers(-(2**60), 2**60), st.floats(), st.text(max_size=5))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(values, values), max_size=4))
@example([("\r0", "a\nb"), (None, '"')])
def test_answers_survive_json_and_csv(rows: list[tuple[Any, Any]]) -> None:
    given_ = Answer(("a", "b"), tuple(rows))
    told = json.loads(given_.as_json(), parse_constant=lambda name: pytest.fail(name))
    for row, (a, b) in zip(told, rows, strict=True):
        for got, value in ((row["a"], a), (row["b"], b)):
            lost = isinstance(value, float) and not math.isfinite(value)
            assert got == (None if lost else value)
            assert type(got) is type(value) or lost
    read = list(csv.reader(io.StringIO(given_.as_csv(), newline="")))
    assert read[0] == ["a", "b"]
    assert len(read) == len(rows) + 1


def test_a_name_that_comes_again_gets_a_number(run: Path) -> None:
    found = ask([run], "SELECT run, run, 1 AS run_1 FROM trials LIMIT 1")
    assert len(set(found.names)) == 3


def say(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = cli._status(cli.app, list(arguments))
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_the_command_prints_a_table_json_or_csv(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sql = "SELECT teacher, score, found FROM verdicts WHERE trial = 4 ORDER BY teacher"
    status, out, err = say(capsys, "query", str(run), sql)
    assert (status, err) == (0, "")
    assert "teacher_0" in out
    assert out.endswith("2 rows\n")
    rows = json.loads(say(capsys, "query", str(run), sql, "--json")[1])
    assert [row["teacher"] for row in rows] == ["teacher_0", "teacher_1"]
    assert rows[1]["score"] is None
    lines = say(capsys, "query", str(run), sql, "--csv")[1].splitlines()
    assert lines[0] == "teacher,score,found"
    assert lines[2] == "teacher_1,,true"
    assert float(lines[1].split(",")[1]) == rows[0]["score"]


def test_the_command_lists_all_columns(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = say(capsys, "query")[1]
    assert all(each["column"] in out and each["meaning"] in out for each in listed())
    assert say(capsys, "query", str(run))[1] == out
    assert json.loads(say(capsys, "query", "--json")[1]) == list(listed())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("SELECT 1 FROM verdicts",), "has no run"),
        (("runs/nothing",), "no run directory and no query"),
        ((".", "FROM verdicts"), "no run directory"),
        (("RUN", "SELECT nothing FROM verdicts"), "no column 'nothing'"),
        (("RUN", "FROM trials", "--json", "--csv"), "either JSON or CSV"),
    ],
)
def test_a_wrong_command_is_one_line_and_status_2(
    run: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    given_ = [str(run) if word == "RUN" else word for word in arguments]
    status, out, err = say(capsys, "query", *given_)
    assert (status, out) == (2, "")
    assert err.startswith("testbed: ")
    assert err.count("\n") == 1
    assert told in err


def test_a_damaged_trial_is_told_beside_the_answer(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = copied(run, tmp_path / "broken")
    (broken / "trials" / "default" / "1.parquet").write_bytes(b"rubbish")
    status, out, err = say(capsys, "query", str(broken), "SELECT count(*) AS n FROM verdicts", "--json")
    assert (status, json.loads(out)) == (0, [{"n": 10}])
    assert "trial 1 of broken is damaged" in err
    assert err.count("\n") == 1
