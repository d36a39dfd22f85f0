"""The printed board: every size is read back from the page itself."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from testbed.errors import UserError
from testbed.hardware.calibration.board_pdf import write_board
from testbed.hardware.calibration.charuco import BoardDetector, CharucoSpec

SHIPPED = Path(__file__).parents[1] / "hardware" / "board" / "charuco_a4.pdf"
POINT = 25.4 / 72  # mm
Box = tuple[float, float, float, float]


def drawn(pdf: bytes) -> tuple[tuple[float, float], list[tuple[float, Box]]]:
    """Size of the page (mm), and what is filled on it: grey level and box (mm; left, top, right, bottom), in order."""
    wide, high = (float(number) * POINT for number in re.findall(rb"MediaBox \[ 0 0 (\S+) (\S+) \]", pdf)[0])
    texts = []
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL):
        try:
            texts.append(zlib.decompress(stream).decode("latin-1"))
        except zlib.error:
            continue
    page = max(texts, key=lambda text: text.count(" l\n"))
    boxes, grey, kept, points, numbers = [], 0.0, [], [], []
    for word in re.sub(r"BT.*?ET", "", page, flags=re.DOTALL).split():
        match word:
            case "q":
                kept.append(grey)
            case "Q":
                grey = kept.pop()
            case "g":
                grey = numbers[-1]
            case "m" | "l":
                points.append(numbers[-2:])
            case "f" | "n" | "S":
                if word == "f":
                    x, y = np.array(points).T * POINT
                    boxes.append((grey, (x.min(), high - y.max(), x.max(), high - y.min())))
                points = []
            case _ if re.fullmatch(r"-?[\d.]+", word):
                numbers.append(float(word))
    return (wide, high), boxes


def printed(boxes: list[tuple[float, Box]], dots: float = 4.0) -> NDArray[np.uint8]:
    """The page as dots, so many to a millimetre."""
    page = np.full((round(210 * dots), round(297 * dots)), 255, np.uint8)
    for grey, box in boxes:
        left, top, right, bottom = (round(side * dots) for side in box)
        page[top:bottom, left:right] = round(255 * grey)
    return page


def test_the_shipped_page_is_a4_and_to_scale() -> None:
    size, boxes = drawn(SHIPPED.read_bytes())
    assert size == pytest.approx((297, 210), abs=1e-3)
    squares = [box for grey, box in boxes if grey == 0 and box[2] - box[0] == pytest.approx(28, abs=1e-3)]
    assert len(squares) == 27
    assert all(box[3] - box[1] == pytest.approx(28, abs=1e-3) for box in squares)
    left, top = min(box[0] for box in squares), min(box[1] for box in squares)
    right, bottom = max(box[2] for box in squares), max(box[3] for box in squares)
    assert (right - left, bottom - top) == pytest.approx((252, 168), abs=2e-3)
    assert min(left, top, 297 - right, 210 - bottom) > 12  # printers leave a rim
    rulers = [box for grey, box in boxes if grey == 0 and box[2] - box[0] == pytest.approx(100, abs=1e-3)]
    assert len(rulers) == 1
    marks = [box for _, box in boxes if box[1] > bottom and box[2] - box[0] < 0.2]
    assert len(marks) == 101
    assert min(mark[0] for mark in marks) == pytest.approx(rulers[0][0], abs=1e-3)
    assert max(mark[2] for mark in marks) == pytest.approx(rulers[0][2], abs=1e-3)


def test_the_detector_finds_every_corner_of_the_printed_page_where_it_should_be() -> None:
    _, boxes = drawn(SHIPPED.read_bytes())
    spec, dots = CharucoSpec(), 4.0
    view = BoardDetector(spec).find(printed(boxes, dots))
    assert view is not None
    assert len(view.ids) == spec.corner_count
    places = (view.points + 0.5) / dots
    wanted = spec.corners()[:, :2] * 1e3 + [(297 - 252) / 2, 13]
    assert np.abs(places - wanted).max() < 0.05


def test_the_shipped_page_is_what_is_written_now(tmp_path: Path) -> None:
    write_board(tmp_path / "a.pdf")
    write_board(tmp_path / "b.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
    size, boxes = drawn((tmp_path / "a.pdf").read_bytes())
    shipped_size, shipped = drawn(SHIPPED.read_bytes())
    assert size == shipped_size
    assert [grey for grey, _ in boxes] == [grey for grey, _ in shipped]
    assert np.allclose([box for _, box in boxes], [box for _, box in shipped], atol=1e-3)


def test_a_board_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not fit on A4"):
        write_board(tmp_path / "a.pdf", CharucoSpec(square=0.04))
    assert not list(tmp_path.iterdir())


def test_a_printer_that_shrinks_is_taken_into_account() -> None:
    spec = CharucoSpec().printed(ruler=0.097)
    assert spec.square == pytest.approx(0.97 * 0.028)
    assert spec.marker / spec.square == pytest.approx(0.6)
