"""The desk that the page is made on: the run, its sample trial, everybody's bodies, and a place for figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from matplotlib.figure import Figure

from testbed.experiment.atomic import write_text
from testbed.morphology import Morphology, load_robot
from testbed.report import html
from testbed.report.reading import Row, RunRecord, Trial
from testbed.report.style import inline, svg
from testbed.vision import StereoRig


@dataclass(frozen=True)
class Desk:
    """What every section of the page draws from.

    Attributes:
        run: The run.
    """

    run: RunRecord

    @property
    def cell(self) -> str:
        """The cell that the figures are about: the first."""
        return self.run.cells[0]

    @property
    def rows(self) -> tuple[Row, ...]:
        """The verdict rows of that cell."""
        return tuple(row for row in self.run.rows if row["cell"] == self.cell)

    @property
    def trials(self) -> tuple[Trial, ...]:
        """The trials of that cell."""
        return self.run.of_cell(self.cell)

    @property
    def sample(self) -> Trial | None:
        """The trial that is told in pictures: the first, whatever came out."""
        return self.trials[0] if self.trials else None

    @property
    def acted(self) -> Trial | None:
        """The first trial in which the student imitated somebody, or else the sample."""
        return next((trial for trial in self.trials if any(row["chosen"] for row in trial.rows)), self.sample)

    @cached_property
    def bodies(self) -> dict[str, Morphology]:
        """Everybody's body by agent name, the student first."""
        scenario = self.run.scenario
        robots = {"student": scenario["student"]["robot"]}
        robots |= {f"teacher_{index}": teacher["robot"] for index, teacher in enumerate(scenario["teachers"])}
        return {name: load_robot(robot) for name, robot in robots.items()}

    @property
    def student(self) -> Morphology:
        """The student's true body."""
        return self.bodies["student"]

    @property
    def rig(self) -> StereoRig:
        """The student's eyes."""
        rig = self.run.scenario["rig"]
        return StereoRig(field_of_view=math.radians(rig["field_of_view_deg"]), baseline=rig["baseline"])

    @property
    def folder(self) -> Path:
        """Where the figures go."""
        return self.run.directory / "figures"

    def picture(
        self, drawing: Figure | None, name: str, label: str, caption: str, *, on_page: Figure | None = None
    ) -> str:
        """Keep a figure under ``figures/`` and hand it to the page; nothing where there is no figure.

        Args:
            drawing: The figure.
            name: Its file name without ending.
            label: What it shows, for readers who cannot see it.
            caption: What stands below it; HTML.
            on_page: A plainer drawing of the same, where the page already shows the rest.
        """
        if drawing is None:
            return ""
        text = svg(drawing, name)
        write_text(self.folder / f"{name}.svg", text)
        shown = text if on_page is None else svg(on_page, f"{name}-plain")
        return html.figure(inline(shown, label), caption)
