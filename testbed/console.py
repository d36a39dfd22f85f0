"""What a run looks like on a terminal, and as plain lines where there is none."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from testbed.errors import shown_path

if TYPE_CHECKING:
    from testbed.experiment.jobs import Job

_COLOURS = {"appropriate": "blue", "inappropriate": "yellow"}
_MOST_ROWS = 12


class Bars:
    """Progress on a terminal.

    A single trial has a bar a phase; many have one over all of them and one for each that is running.
    """

    def __init__(self, console: Console) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=32),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=console,
        )
        self._single = True
        self._overall: TaskID | None = None
        self._phases: dict[tuple[Job, str], TaskID] = {}

    def __enter__(self) -> Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def started(self, path: Path, total: int, finished: int) -> None:
        """Show where the run goes, and the bar over all trials where there are several."""
        if finished:
            self.notice(f"continuing {shown_path(path)}: {finished} of {total} trials are finished")
        self._single = total - finished <= 1
        if total > 1:
            self._overall = self._progress.add_task("[bold]trials", total=total, completed=finished)

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        """Move the phase's bar; with many trials a trial shows only the phase that it is in."""
        key = (job, phase)
        if key not in self._phases:
            if not self._single:
                self._drop(job)
            name = phase if self._single else f"{job}: {phase}"
            self._phases[key] = self._progress.add_task(escape(name), total=max(total, 1))
        self._progress.update(self._phases[key], completed=done if total else 1, total=max(total, 1))

    def finished(self, job: Job) -> None:
        """Count the trial."""
        self._advance(job)

    def failed(self, job: Job, why: str, file: Path) -> None:
        """Count the trial and say why it failed."""
        self._advance(job)
        self.notice(f"{job} failed: {why}; see {shown_path(file)}")

    def left_out(self, job: Job, why: str) -> None:
        """Count the trial; why it cannot be is told at the end."""
        self._advance(job)

    def notice(self, text: str) -> None:
        """A line above the bars."""
        self._progress.console.print(escape(text), style="yellow", soft_wrap=True)

    def _advance(self, job: Job) -> None:
        if not self._single:
            self._drop(job)
        if self._overall is not None:
            self._progress.advance(self._overall)

    def _drop(self, job: Job) -> None:
        for key in [key for key in self._phases if key[0] == job]:
            self._progress.remove_task(self._phases.pop(key))


class Lines:
    """Progress as plain lines, for logs: when a phase of a single trial ends, or one of many trials."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._total = 1
        self._done = 0
        self._fresh = 0
        self._began = time.monotonic()

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def started(self, path: Path, total: int, finished: int) -> None:
        """Say where the run goes."""
        self._total, self._done = total, finished
        self._began = time.monotonic()
        self.notice(f"{shown_path(path)}: {finished} of {total} trials are finished")

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        """A line when a phase of the only trial ends."""
        if self._total == 1 and done >= total:
            self.notice(f"{phase}: done after {time.monotonic() - self._began:.1f} s")

    def finished(self, job: Job) -> None:
        """A line with the time that is left, going by the trials so far."""
        self._count(job, "finished")

    def failed(self, job: Job, why: str, file: Path) -> None:
        """A line with the reason."""
        self._count(job, f"failed: {why}; see {shown_path(file)}")

    def left_out(self, job: Job, why: str) -> None:
        """A line with the reason."""
        self._count(job, f"left out: {why}")

    def notice(self, text: str) -> None:
        """A line."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _count(self, job: Job, what: str) -> None:
        self._done += 1
        self._fresh += 1
        left = (time.monotonic() - self._began) / self._fresh * (self._total - self._done)
        rest = f" ({self._done} of {self._total}, about {_duration(left)} left)" if self._total > 1 else ""
        self.notice(f"{job} {what}{rest}")


def display_on(console: Console) -> Bars | Lines:
    """The display that suits the console; use it as a context manager."""
    return Bars(console) if console.is_terminal else Lines(console)


def verdict_table(contents: Mapping[str, Any]) -> Table:
    """The verdicts of a run: each of them where they are few, a line a student and robot where they are many.

    Args:
        contents: As in ``verdicts.json``.
    """
    rows = contents["verdicts"]
    return _each(rows) if len(rows) <= _MOST_ROWS else _together(rows)


def summary_lines(contents: Mapping[str, Any]) -> list[str]:
    """In sentences: the reasons where verdicts are few, each student's share of right ones, what it knows of itself."""
    rows, lines = contents["verdicts"], []
    if len(rows) <= _MOST_ROWS:
        lines += [
            f"{row['student']} of {row['teacher']}: {row['reason']}" for row in rows if row.get("reason")
        ]
    lines += [_sentence(name, summary) for name, summary in contents["summary"].items()]
    return lines if rows else [*lines, *_about_themselves(contents.get("selves", []))]


def _verdict_sheet() -> Table:
    # Without vertical lines every column fits in 80 characters, and no word is cut.
    return Table(
        title="Whom to imitate?", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False
    )


def _each(rows: list[Mapping[str, Any]]) -> Table:
    trials, students = ({row[name] for row in rows} for name in ("trial", "student"))
    first = [name for name, values in (("trial", trials), ("student", students)) if len(values) > 1]
    table = _verdict_sheet()
    for heading in (*first, "teacher", "robot", "verdict", "", "sure", "score", "chosen"):
        table.add_column(heading, justify="right" if heading in ("trial", "sure", "score") else "left")
    for row in rows:
        verdict = row["verdict"]
        cells = [row["teacher"], row["robot"], _coloured(verdict), _mark(verdict == row["truth"])]
        cells += [_share(row.get("probability"), verdict), _number(row["score"])]
        table.add_row(*(str(row[name]) for name in first), *cells, "yes" if row.get("chosen") else "no")
    return table


def _together(rows: list[Mapping[str, Any]]) -> Table:
    first = ("student",) if len({row["student"] for row in rows}) > 1 else ()
    names = (*first, "robot", "truth")
    table = _verdict_sheet()
    for heading in (*names, "judged appropriate", "right"):
        table.add_column(heading)
    for key in dict.fromkeys(tuple(row[name] for name in names) for row in rows):
        group = [row for row in rows if tuple(row[name] for name in names) == key]
        yes = sum(row["verdict"] == "appropriate" for row in group)
        right = sum(row["verdict"] == row["truth"] for row in group)
        shares = (f"{yes} of {len(group)}", f"{right / len(group):.0%}")
        table.add_row(*key[:-1], _coloured(key[-1]), *shares)
    return table


def _sentence(name: str, summary: Mapping[str, Any]) -> str:
    n = summary["n"]
    right = round(summary["accuracy"] * n)
    text = f"student {name}: {right} of {n} verdicts are right"
    text += f" (95% interval {summary['accuracy_low']:.0%} to {summary['accuracy_high']:.0%})"
    if summary["auc"] is not None and summary["auc_low"] is not None:
        text += f"; AUC {summary['auc']:.2f} ({summary['auc_low']:.2f} to {summary['auc_high']:.2f})"
    return text


def _about_themselves(selves: list[Mapping[str, Any]]) -> list[str]:
    lines = []
    for key in dict.fromkeys((row["cell"], row["student"]) for row in selves):
        group = [row for row in selves if (row["cell"], row["student"]) == key]
        right = sum(bool(row["topology_right"]) for row in group)
        lines.append(f"{key[0]}, student {key[1]}: {right} of {len(group)} know how their limbs are joined")
    return lines


def _share(probability: float | None, verdict: str) -> str:
    """How sure the student is of what it says."""
    if probability is None:
        return ""
    return f"{probability if verdict == 'appropriate' else 1 - probability:.0%}"


def _coloured(word: str) -> str:
    colour = _COLOURS.get(word)
    return f"[{colour}]{escape(word)}[/]" if colour else escape(word)


def _mark(right: bool) -> str:
    return "right" if right else "[red]wrong[/]"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3f}"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
