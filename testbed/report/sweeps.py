"""The section about a sweep: what was swept, whether all conditions are as good as the control, and where not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbed.experiment.conditions import (
    MEASURES,
    Answer,
    Condition,
    Finding,
    Measured,
    conditions_of,
    finding,
)
from testbed.experiment.roc import Difference
from testbed.report import html
from testbed.report.comparison import figure_with, share
from testbed.report.desk import Desk
from testbed.report.reading import Row, chosen_rows
from testbed.report.sweep_figures import axis_figure, labelled, sign, tile_figure
from testbed.report.trend_figures import trend_figure
from testbed.scenario import sweep_of
from testbed.scenario.points import Block
from testbed.scenario.sweep import UNNAMED, level_name

_CSS: dict[Answer, str] = {"holds": "reproduced", "does not hold": "not", "cannot tell": "cannot"}
_FEW = 6  # so many conditions are listed openly
_MOST_NAMED = 4


def sweeps(desk: Desk) -> str:
    """The whole section; empty for a run without a sweep, or without verdicts."""
    blocks = sweep_of(desk.run.scenario).blocks
    if not blocks or not desk.run.rows:
        return ""
    told = "".join(_block(desk, block, alone=len(blocks) == 1) for block in blocks.values())
    return html.section("Does it hold elsewhere?", told, lead=_lead(desk, list(blocks.values())))


def _lead(desk: Desk, blocks: Sequence[Block]) -> str:
    scenario = desk.run.scenario
    split = (
        f" These are teachers of the split <em>{html.text(scenario.split)}</em>." if scenario.split else ""
    )
    margins = {f"{block.spec.margin:g}" for block in blocks}
    return (
        f"{html.text(desk.mind)} in {sum(len(block.points) for block in blocks)} conditions, "
        f"{scenario.trials} trial{'' if scenario.trials == 1 else 's'} each, against the same trials of the control. "
        f"A loss within {' or '.join(sorted(margins))} counts as none. It holds where the 95% interval of every "
        "condition's difference excludes a larger loss; it does not where some condition's excludes a smaller one, at "
        f"a level that all conditions share.{split}"
    )


def _block(desk: Desk, block: Block, *, alone: bool) -> str:
    rows = desk.run.verdicts(student=desk.mind)
    control, others = conditions_of(rows, block.control, block.points)
    title = (
        "" if alone and block.name == UNNAMED else f"<h3>{html.text(labelled(block.name).capitalize())}</h3>"
    )
    if control is None and not others:
        return f"{title}<p>No trial of it is finished.</p>"
    by_axis = {name: [one for one in others if _differs(one, block) == [name]] for name in block.axes}
    claims: list[tuple[str, Sequence[Condition]]] = [entry for entry in by_axis.items() if entry[1]]
    if len(others) > max((len(conditions) for _, conditions in claims), default=0):
        claims.append(("", others))
    about = html.text(" and ".join(map(labelled, block.axes)))
    tiles = desk.picture(
        tile_figure(block, control, others),
        f"sweep-{block.name}",
        f"AUC and right verdicts over {about}",
        "Each tile is a condition, the control framed: figures with 95% intervals above, differences to the control "
        "below, and whether a loss beyond the margin is excluded (<em>no worse</em>), certain (<em>worse</em>; "
        "<em>likely</em> if only where a condition is looked at by itself) or neither (<em>open</em>). Hatched: cannot "
        "be, or not finished.",
    )
    trends = desk.picture(
        trend_figure(block, rows),
        f"sweep-{block.name}",
        f"Right verdicts and scores along {about}",
        "A dot is a condition, whose other parameters differ as well; the line is the local mean over all of them with "
        "its 95% interval over conditions and trials. The control is the open circle.",
    )
    lines = desk.picture(
        None if tiles or trends else axis_figure(block, control, by_axis),
        f"sweep-{block.name}",
        f"AUC and right verdicts along {about}",
        "Each condition with its 95% interval. The band is the control's, and the open circle where the axis has a "
        "place for it.",
    )
    table = _table(control, others, block)
    listed = table if len(others) <= _FEW else html.details(f"All {len(others)} conditions", table)
    knowing = _knowing(desk, block)
    return "".join(
        [
            title,
            _claims(claims, block),
            tiles or trends or lines,
            listed,
            knowing,
            _missing(desk, block, others),
        ]
    )


def _differs(condition: Condition, block: Block) -> list[str]:
    """In which axes a condition is otherwise than the control."""
    levels = block.control.levels
    return [name for name in block.axes if condition.levels[name] != levels[name]]


def _claims(claims: Sequence[tuple[str, Sequence[Condition]]], block: Block) -> str:
    body = []
    for name, conditions in claims:
        for measure, title in MEASURES.items():
            found = finding(conditions, measure, block.spec.margin)
            what = f"whatever the {labelled(name)}" if name else "in all conditions together"
            answer = "cannot tell at this N" if found.answer == "cannot tell" else found.answer
            body.append(
                [
                    f"{html.text(title)}: as good {html.text(what)}",
                    f'<span class="outcome {_CSS[found.answer]}">{answer}</span>',
                    html.prose(_told(found, measure, block)),
                ]
            )
    return html.table(["the claim", "here", "numbers"], body, css="claims") if body else ""


def _told(found: Finding, measure: str, block: Block) -> str:
    text = f"A loss beyond {block.spec.margin:g} is excluded in {found.holding} of {found.conditions} conditions."
    if found.worst is not None:
        difference = found.worst.measures[measure].difference
        if difference is not None and difference.value < 0:
            text += f" The largest is {_gap(difference)} at {_at(found.worst, block)} (N = {difference.n})."
        elif difference is not None:
            text += f" None lost anything (N = {difference.n})."
    if found.needed is not None:
        text += f" About {_rounded(found.needed)} trials a condition would tell."
    return text


def _at(condition: Condition, block: Block) -> str:
    names = _differs(condition, block) or list(block.axes)
    return ", ".join(f"{labelled(name)} {level_name(condition.levels[name])}" for name in names)


def _rounded(number: int) -> int:
    """A number of trials to two digits."""
    return int(float(f"{number:.2g}"))


def _gap(difference: Difference) -> str:
    ends = difference.interval
    text = f"{difference.value:+.3f}" + (
        f" ({ends.low:+.3f} to {ends.high:+.3f})" if ends is not None else ""
    )
    return text.replace("-", "\N{MINUS SIGN}")


def _table(control: Condition | None, others: Sequence[Condition], block: Block) -> str:
    header = [*map(html.text, map(labelled, block.axes)), "verdicts"]
    for title in MEASURES.values():
        header += [title, "less the control's", ""]
    body = []
    for condition in ([control] if control is not None else []) + list(others):
        line = ["–" if level is None else html.text(level_name(level)) for level in condition.levels.values()]
        line.append(str(condition.n))
        for measure, measured in condition.measures.items():
            line += _measured(measured, measure, block.spec.margin, is_control=condition is control)
        body.append(line)
    return html.table(header, body, css="figures")


def _measured(measured: Measured, measure: str, margin: float, *, is_control: bool) -> list[str]:
    percent = measure == "accuracy"
    shown = html.number(None)
    if measured.value is not None:
        shown = figure_with(measured.value, measured.interval, percent=percent)
    if is_control:
        return [shown, "the control", ""]
    if measured.difference is None:
        return [shown, html.number(None), "open"]
    gap, _, ends = _gap(measured.difference).partition(" (")
    below = f"<br><small>{ends.rstrip(')')}</small>" if ends else ""
    return [shown, gap + below, sign(measured, margin)]


def _knowing(desk: Desk, block: Block) -> str:
    """What the student found out about its own body, where the block changes it or its senses."""
    points = (block.control, *block.points)
    if not any(change.place.startswith(("student", "world")) for point in points for change in point.changes):
        return ""
    own: dict[str, list[Row]] = {}
    for row in chosen_rows(desk.run.selves, student=desk.mind):
        own.setdefault(str(row["cell"]), []).append(row)
    body = []
    for point in points:
        rows = own.get(point.cell, [])
        if not rows:
            continue
        errors = [float(row["angle_error_deg"]) for row in rows if row.get("angle_error_deg") is not None]
        held = [
            bool(row["posterior_holds_truth"]) for row in rows if row.get("posterior_holds_truth") is not None
        ]
        line = ["–" if level is None else html.text(level_name(level)) for level in point.levels.values()]
        line += [share([bool(row["topology_right"]) for row in rows])]
        line += [f"{np.median(errors):.1f}°" if errors else html.number(None), share(held)]
        body.append(line)
    header = [*map(html.text, map(labelled, block.axes)), "knows how its limbs are joined"]
    header += ["worst angle, median", "its posterior holds the truth"]
    return f"<p>What it knows of itself:</p>{html.table(header, body, css='figures')}" if body else ""


def _missing(desk: Desk, block: Block, others: Sequence[Condition]) -> str:
    """Which cells have no trial, and why; and how many trials are missing elsewhere."""
    there = {condition.cell for condition in others}
    impossible: list[str] = []
    failed: list[str] = []
    reason = ""
    for point in block.points:
        if point.cell in there:
            continue
        why = _error(desk, point.cell)
        where = ", ".join(f"{labelled(name)} {level_name(level)}" for name, level in point.levels.items())
        if block.spec.impossible == "leave_out" and why and "Traceback" not in why:
            impossible.append(where)
            reason = reason or why.strip().splitlines()[-1]
        else:
            failed.append(where)
    lost = sum(desk.run.scenario.trials - condition.trials for condition in others)
    parts = []
    if impossible:
        count = f"{len(impossible)} condition{'' if len(impossible) == 1 else 's'} cannot be"
        parts.append(f"{count}: {_few(impossible)}. {_plain(reason)}")
    if failed:
        parts.append(f"Without a finished trial: {_few(failed)}; running again tries them again.")
    if lost > 0:
        parts.append(
            f"{lost} trial{'' if lost == 1 else 's'} of the others are missing; running again tries them."
        )
    return "".join(f'<p class="none">{html.text(part)}</p>' for part in parts)


def _error(desk: Desk, cell: str) -> str:
    try:
        return (desk.run.directory / "trials" / cell / "0.error.txt").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _plain(reason: str) -> str:
    """The reason without the file's name and line."""
    head, separator, rest = reason.partition(": ")
    told = rest if separator and head.rpartition(":")[2].isdigit() else reason
    return f"E.g.: {told.partition(';')[0]}." if told else ""


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return "; ".join(names[:_MOST_NAMED]) + more
