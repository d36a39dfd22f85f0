"""The desk that the page is made on: the run as one of its minds tells it, the bodies, and a place for figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from matplotlib.figure import Figure

from testbed.bodies.morphology import Morphology
from testbed.experiment.atomic import write_text
from testbed.report import html
from testbed.report.reading import Row, RunRecord, Trial, chosen_rows
from testbed.report.style import inline, svg
from testbed.scenario import Scenario, drawn, in_cell
from testbed.vision import StereoRig
from testbed.world.placement import STUDENT, teacher_names


@dataclass(frozen=True)
class Desk:
    """What every section of the page draws from.

    Attributes:
        run: The run.
        mind: Whose story is told.
    """

    run: RunRecord
    mind: str

    @classmethod
    def of(cls, run: RunRecord) -> Desk:
        """The desk of the mind that leads."""
        return cls(run, run.students[0])

    @cached_property
    def cell(self) -> str:
        """The cell that the figures are about: the first that this mind lives in."""
        rows = (*self.run.rows, *self.run.selves)
        own = {row["cell"] for row in rows if row["student"] == self.mind}
        return next(cell for cell in self.run.cells if cell in own)

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """This mind's verdicts in that cell."""
        return tuple(self.run.verdicts(cell=self.cell, student=self.mind))

    @cached_property
    def selves(self) -> tuple[Row, ...]:
        """What this mind found out about its body, trial by trial of that cell."""
        return tuple(chosen_rows(self.run.selves, cell=self.cell, student=self.mind))

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """The trials of that cell, as this mind tells them."""
        return tuple(trial.of(self.mind) for trial in self.run.of_cell(self.cell))

    @property
    def sample(self) -> Trial | None:
        """The trial that is told in pictures: the first, whatever came out."""
        return self.trials[0] if self.trials else None

    @cached_property
    def acted(self) -> Trial | None:
        """The first trial in which the student imitated somebody, or else the sample."""
        return next((trial for trial in self.trials if any(row["chosen"] for row in trial.rows)), self.sample)

    @cached_property
    def by_the_paper(self) -> bool:
        """Whether this mind models teachers as the paper does."""
        minds = in_cell(self.run.scenario, self.cell).minds
        return any(mind.phases.teacher_modelling == "eea" for mind in minds if mind.name == self.mind)

    def concrete(self, trial: Trial) -> Scenario:
        """The scenario of a trial, nothing left to chance."""
        if (trial.cell, trial.number) not in self._drawn:
            here = in_cell(self.run.scenario, trial.cell)
            self._drawn[trial.cell, trial.number] = drawn(here, trial.number)
        return self._drawn[trial.cell, trial.number]

    @cached_property
    def _drawn(self) -> dict[tuple[str, int], Scenario]:
        return {}

    def bodies(self, trial: Trial) -> dict[str, Morphology]:
        """Everybody's true body before any damage by agent name, the student first."""
        concrete = self.concrete(trial)
        teachers = zip(teacher_names(concrete), concrete.teachers, strict=True)
        return {STUDENT: concrete.student.true_body()} | {name: spec.body() for name, spec in teachers}

    def student(self, trial: Trial) -> Morphology:
        """The student's body as it knows its parts, truly joined."""
        return self.concrete(trial).student.body()

    def rig(self, trial: Trial) -> StereoRig:
        """The student's eyes."""
        rig = self.concrete(trial).rig
        return StereoRig(field_of_view=math.radians(rig.field_of_view_deg), baseline=rig.baseline)

    def titled(self, title: str) -> str:
        """A section's title; it says whose section it is where it is not the leader's."""
        return title if self.mind == self.run.students[0] else f"{title} ({self.mind})"

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
            name: Its file name without ending; the mind's name goes before it where it is not the leader's.
            label: What it shows, for readers who cannot see it.
            caption: What stands below it; HTML.
            on_page: A plainer drawing of the same, where the page already shows the rest.
        """
        if drawing is None:
            return ""
        name = name if self.mind == self.run.students[0] else f"{self.mind}_{name}"
        text = svg(drawing, name)
        write_text(self.folder / f"{name}.svg", text)
        shown = text if on_page is None else svg(on_page, f"{name}-plain")
        return html.figure(inline(shown, label), caption)
