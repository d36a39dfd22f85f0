"""The report of a real run, cut down to seconds."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
from test_report import Page

from testbed.report.reading import read_run
from testbed.report.video import frame_count, panes, stride_of
from testbed.resources import scenario_path

COARSE = "rig: {camera_rate: 5}\n"  # with coarser images the student would imitate nobody


def test_a_smoke_run_ends_with_a_page_about_itself(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    file = tmp_path / "whom_to_imitate.yaml"
    file.write_text(scenario_path("whom_to_imitate").read_text(encoding="utf-8") + COARSE, encoding="utf-8")
    command = [sys.executable, "-m", "testbed", "run", str(file), "--smoke", "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    rows = json.loads((folder / "verdicts.json").read_text())["verdicts"]
    assert [float(line[0]) for line in page.numbers[1:]] == [row["score"] for row in rows]
    trial = read_run(folder).trials[0]
    shown = panes(trial)
    film = cv2.VideoCapture(str(folder / "video" / "default-0.mp4"))
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == frame_count(shown, stride_of(trial))
    for pane in shown:
        base = trial.array(f"truth/{pane.agent}/base")
        assert base is not None
        assert pane.first + pane.count <= len(base)
