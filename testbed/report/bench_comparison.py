"""One page that holds a run on the bench against the same run in simulation."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.figure import Figure

from testbed.experiment.atomic import write_text
from testbed.experiment.bench_measures import Measure, agreed, document, measures
from testbed.experiment.sim_and_bench import Comparison, Row
from testbed.report import html
from testbed.report.bench_figures import image_figure, path_figure, roll_figure, tilt_figure
from testbed.report.candidates import truth_mark
from testbed.report.rivals import NUMBERS, PAGE, refuse_foreign
from testbed.report.style import inline, svg

_MOST_TEACHERS = 4
_MOST_PATHS = 4
_MOST_ROWS = 40


def write_bench_comparison(told: Comparison, out: Path) -> Path:
    """Write ``report.html``, ``comparison.json`` and ``figures/*.svg`` into a folder; returns the page's path.

    The same runs give the same files.

    Raises:
        UserError: If the folder holds something else, or cannot be written.
    """
    refuse_foreign(out)
    write_text(out / NUMBERS, json.dumps(document(told), indent=1, ensure_ascii=False) + "\n")
    title = f"{told.bench.scenario.name}: bench and simulation"
    write_text(out / PAGE, html.page(title, _body(told, out / "figures")))
    return out / PAGE


def headline(told: Comparison) -> str:
    """What came out, in one sentence."""
    same, n = agreed(told)
    verdicts = (
        f"Bench and simulation agree in {same} of {n} verdicts" if n else "Without teachers no verdicts"
    )
    gap = next((each for each in measures(told) if each.name.startswith("size of the difference")), None)
    if gap is None:
        return f"{verdicts}."
    return f"{verdicts}; after the same command the body tilts {gap.gap:.1f}° differently."


def _body(told: Comparison, folder: Path) -> str:
    kicker = html.text(f"{told.bench.scenario.name} · on the bench and in simulation")
    trials = len(told.jobs)
    lead = (
        f"{trials} trial{'' if trials == 1 else 's'} of the same scenario, seed and teachers on both sides. "
        "A twin in simulation was given the bench's own commands, step by step, so that tilt and paths differ by the "
        "bodies alone, and not by what the student came to do."
    )
    return "".join(
        [
            f'<header><p class="kicker">{kicker}</p><h1>{html.text(headline(told))}</h1><p>{lead}</p></header>',
            _numbers(told),
            _tilt(told, folder),
            _rolls(told, folder),
            _verdicts(told),
            _paths(told, folder),
            _images(told, folder),
            _footer(told),
        ]
    )


def _numbers(told: Comparison) -> str:
    titles = ["", "N", "simulation", "bench", "difference", "95% interval"]
    body = [_line(each) for each in measures(told)]
    lead = (
        "Differences are bench less simulation, or the size of the difference where the name says so. With several "
        "trials intervals are drawn over trials; with one they are drawn over what N counts, and say nothing about "
        "other days."
    )
    return html.section("In numbers", html.table(titles, body), lead=lead)


def _line(measure: Measure) -> list[str]:
    share = measure.unit == ""
    name = html.text(measure.name)
    if share:
        name += "<br><small>beside: share of right ones on each side</small>"
    of = measure.of.removesuffix("s") if measure.n == 1 else measure.of
    n = f"{measure.n} {html.text(of)}<br><small>{_trials(measure.trials)}</small>"
    low_high = "too few for an interval"
    if measure.interval is not None:
        low, high = (
            _shown(end, measure.unit, signed=measure.simulation is not None) for end in measure.interval
        )
        low_high = f"{low}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{high}<br><small>over {html.text(measure.over)}</small>"
    signed = measure.simulation is not None and not share
    gap = f'<data value="{measure.gap!r}">{_shown(measure.gap, measure.unit, signed=signed)}</data>'
    return [
        name,
        n,
        *(_shown(side, measure.unit) for side in (measure.simulation, measure.bench)),
        gap,
        low_high,
    ]


def _shown(value: float | None, unit: str, *, signed: bool = False) -> str:
    if value is None:
        return ""
    if unit == "":
        return f"{value:.0%}"
    text = f"{value:+.2f}" if signed else f"{value:.2f}"
    space = "" if unit == "°" else "\N{NO-BREAK SPACE}"
    return f"{text}{space}{unit}".replace("-", "\N{MINUS SIGN}")


def _trials(count: int) -> str:
    return f"in {count} trial{'' if count == 1 else 's'}"


def _tilt(told: Comparison, folder: Path) -> str:
    return _pictured(
        "Tilt", tilt_figure(told.tilts), folder, "tilt",
        "Tilt of the main body at the end of each command of the self-discovery: felt on the bench, and of the "
        "simulated twin under the same commands. Blue: nose-down, orange: to the side.",
        "The student did not feel any command on the bench.",
    )  # fmt: skip


def _rolls(told: Comparison, folder: Path) -> str:
    shown = told.rolls[:_MOST_TEACHERS]
    lags = ", ".join(f"{each.teacher} {1000 * each.lag:.0f} ms" for each in shown)
    more = f" The first {len(shown)} of {len(told.rolls)}." if len(told.rolls) > len(shown) else ""
    return _pictured(
        "Rolls", roll_figure(shown), folder, "rolls",
        "How the teachers' parts turned as the student saw them: in simulation (line), on the bench (dots). The line "
        f"is shifted by what the bench is behind: {html.text(lags)}; the difference is taken after that.{more}",
        "No teacher was seen in both with the same number of parts.",
    )  # fmt: skip


def _verdicts(told: Comparison) -> str:
    if not told.verdicts:
        return ""
    split = [pair for pair in told.verdicts if pair[0]["verdict"] != pair[1]["verdict"]]
    shown = told.verdicts if len(told.verdicts) <= _MOST_ROWS else tuple(split[:_MOST_ROWS])
    titles = ["trial", "student", "teacher", "robot", "truth", "in simulation", "on the bench"]
    body = []
    for ours, theirs in shown:
        line = [html.text(ours[name]) for name in ("trial", "student", "teacher", "robot")]
        body.append([*line, truth_mark(str(ours["truth"])), _said(ours), _said(theirs)])
    which = (
        "" if len(shown) == len(told.verdicts) else f"The {len(shown)} of {len(told.verdicts)} that differ."
    )
    return html.section("Verdicts", html.table(titles, body, css="verdicts"), lead=which)


def _said(row: Row) -> str:
    right = row["verdict"] == row["truth"]
    probability = row.get("probability")
    sure = ""
    if probability is not None:
        sure = (
            f" <small>{probability if row['verdict'] == 'appropriate' else 1 - probability:.0%} sure</small>"
        )
    return f'<span class="{"right" if right else "wrong"}">{html.text(row["verdict"])}</span>{sure}'


def _paths(told: Comparison, folder: Path) -> str:
    nothing = (
        "Nobody measured where things are on this bench, so there is nothing to hold the simulation's paths against."
        if told.placeless
        else "There is no trial in which the student imitated somebody on both sides."
    )
    more = f" The first {_MOST_PATHS}." if len(told.paths) > _MOST_PATHS else ""
    return _pictured(
        "Paths", path_figure(told.paths[:_MOST_PATHS]), folder, "paths",
        "Where the student went while it imitated: from above, from the cross on, its own axis at the beginning to the "
        f"right; and how far along that axis, over time. Broken: the simulated body under the bench's commands.{more}",
        nothing,
    )  # fmt: skip


def _images(told: Comparison, folder: Path) -> str:
    return _pictured(
        "What the student saw", image_figure(told.images), folder, "images",
        "The first pair of images of the same teacher, as the student gets them.", "",
    )  # fmt: skip


def _pictured(title: str, drawing: Figure | None, folder: Path, name: str, caption: str, nothing: str) -> str:
    if drawing is None:
        return html.section(title, lead=nothing) if nothing else ""
    text = svg(drawing, name)
    write_text(folder / f"{name}.svg", text)
    return html.section(title, html.figure(inline(text, title), caption))


def _footer(told: Comparison) -> str:
    listed = []
    for name, run in (("simulation", told.simulation), ("bench", told.bench)):
        source = run.provenance.get("source") or "unknown source"
        bench = run.provenance.get("bench")
        about = f"{run.path.name}, content hash {run.hash8}, seed {run.scenario.seed}, {source}"
        listed.append(f"<dt>{name}</dt><dd>{html.text(about + (f', bench {bench}' if bench else ''))}</dd>")
    return f"<footer><h2>Where this comes from</h2><dl>{''.join(listed)}</dl></footer>"
