"""Cameras as OpenCV reads them: files, a stream over the network, devices by name, and settings that may lie."""

from __future__ import annotations

import http.server
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from testbed.hardware.clock import WallClock
from testbed.hardware.failures import CameraMissing
from testbed.hardware.rig.cameras import VideoCamera, found_cameras, lock_settings, read_settings

SIZE = (640, 480)


def picture(number: int) -> NDArray[np.uint8]:
    """A frame that tells its number: that many bright columns of 8 pixels."""
    image = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
    image[:, : 8 * number] = 220
    return image


def number_of(image: NDArray[np.uint8]) -> int:
    grey = image if image.ndim == 2 else image[..., 1]
    return round(float((grey[240] > 130).sum()) / 8)


def until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return False


@pytest.fixture
def pictures(tmp_path: Path) -> str:
    for number in range(20):
        cv2.imwrite(str(tmp_path / f"{number:04d}.png"), picture(number))
    return str(tmp_path / "%04d.png")


def test_a_sequence_of_pictures_comes_in_order_and_its_end_is_told(pictures: str) -> None:
    camera = VideoCamera(pictures, WallClock(), rate=200)
    seen: dict[int, tuple[int, float]] = {}

    def watch() -> bool:
        try:
            for frame in camera.recent():
                seen[frame.number] = number_of(frame.image), frame.at
        except CameraMissing:
            return True
        return False

    assert until(watch)
    camera.close()
    camera.close()
    assert len(seen) > 10
    assert all(number == shown for number, (shown, _) in seen.items())
    times = [at for _, (_, at) in sorted(seen.items())]
    assert np.all(np.diff(times) > 0)
    with pytest.raises(CameraMissing, match="ended"):
        camera.newest()


def test_a_film_comes_at_its_own_rate(tmp_path: Path) -> None:
    file = str(tmp_path / "film.avi")
    writer = cv2.VideoWriter(file, cv2.VideoWriter.fourcc(*"MJPG"), 100.0, SIZE)
    for number in range(60):
        writer.write(picture(number))
    writer.release()
    camera = VideoCamera(file, WallClock())
    assert until(lambda: (frame := camera.newest()) is not None and frame.number >= 10)
    frames = camera.recent()
    assert [number_of(frame.image) for frame in frames] == [frame.number for frame in frames]
    assert np.diff([frame.at for frame in frames]).min() >= 0.009
    assert camera.lock() == ()
    assert camera.settings() == {}
    camera.close()


class Stream(http.server.BaseHTTPRequestHandler):
    """Serves MJPEG: numbered pictures, for ever or until told to stop."""

    stop = threading.Event()

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        number = 0
        while not self.stop.is_set():
            _, data = cv2.imencode(".jpg", picture(number % 60))
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
            try:
                self.wfile.write(head.encode() + data.tobytes() + b"\r\n")
            except OSError:
                return
            number += 1
            time.sleep(0.02)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def stream() -> Iterator[str]:
    Stream.stop = threading.Event()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stream)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/left.mjpg"
    Stream.stop.set()
    server.shutdown()
    server.server_close()


def test_a_stream_over_the_network_is_a_camera_and_its_end_is_told(stream: str) -> None:
    camera = VideoCamera(stream, WallClock())
    assert camera.id == stream
    first = camera.newest()
    assert first is not None
    assert first.image.shape == (480, 640, 3)
    assert until(lambda: (frame := camera.newest()) is not None and frame.number > first.number + 5)
    frames = camera.recent()
    shown = [number_of(frame.image) for frame in frames]
    assert np.all(np.diff(shown) % 60 == 1)  # none is lost or repeated
    Stream.stop.set()

    def told() -> bool:
        try:
            camera.newest()
        except CameraMissing:
            return True
        return False

    assert until(told, 20.0)
    camera.close()


def test_a_reader_that_dies_is_told(pictures: str, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = VideoCamera(pictures, WallClock(), rate=50)

    def broken() -> float:
        raise RuntimeError("the clock fell off")

    monkeypatch.setattr(camera._clock, "now", broken)
    assert until(lambda: camera._ended is not None)
    with pytest.raises(CameraMissing, match="the clock fell off"):
        camera.newest()
    camera.close()


def test_what_is_not_there_or_another_size_is_named(pictures: str, tmp_path: Path) -> None:
    with pytest.raises(CameraMissing, match="no camera /dev/v4l/by-id/nothing"):
        VideoCamera("/dev/v4l/by-id/nothing", WallClock())
    with pytest.raises(CameraMissing, match=r"cannot be opened|no frames"):
        VideoCamera(str(tmp_path / "nothing.avi"), WallClock())
    with pytest.raises(CameraMissing, match="640 x 480 instead of 320 x 240"):
        VideoCamera(pictures, WallClock(), size=(320, 240))


def test_cameras_are_found_by_names_that_stay(tmp_path: Path) -> None:
    by_id, by_path, dev = (tmp_path / name for name in ("by-id", "by-path", "dev"))
    for folder in (by_id, by_path, dev):
        folder.mkdir()
    for number in range(4):
        (dev / f"video{number}").touch()
    # Each camera has a second device, for its metadata; two without serial numbers share one name in by-id.
    (by_id / "usb-ACME_Cam_01-video-index0").symlink_to(dev / "video0")
    (by_id / "usb-ACME_Cam_01-video-index1").symlink_to(dev / "video1")
    (by_path / "pci-usb-0:1-video-index0").symlink_to(dev / "video0")
    (by_path / "pci-usb-0:2-video-index0").symlink_to(dev / "video2")
    found = found_cameras(by_id, by_path)
    assert [(Path(info.id).name, Path(info.device).name) for info in found] == [
        ("usb-ACME_Cam_01-video-index0", "video0"),
        ("pci-usb-0:2-video-index0", "video2"),
    ]
    assert found_cameras(tmp_path / "nothing") == []


class Driver:
    """Settings as drivers have them: some do what they are told, some say so and do not."""

    def __init__(self, *, obeys: bool) -> None:
        self.obeys = obeys
        self.values = {
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_EXPOSURE: 157.0,
            cv2.CAP_PROP_AUTO_WB: 1.0,
            cv2.CAP_PROP_WB_TEMPERATURE: 4600.0,
        }

    def get(self, setting: int) -> float:
        if setting == cv2.CAP_PROP_EXPOSURE and self.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 3.0:
            self.values[setting] += 1  # automatic: never the same twice
        return self.values.get(setting, -1.0)

    def set(self, setting: int, value: float) -> bool:
        if self.obeys and setting in self.values:
            self.values[setting] = value
        return True


def test_settings_are_locked_and_read_back() -> None:
    driver = Driver(obeys=True)
    before = read_settings(driver)
    assert set(before) == {"exposure", "automatic exposure", "white balance", "automatic white balance"}
    assert lock_settings(driver) == []
    assert driver.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    assert driver.values[cv2.CAP_PROP_AUTO_WB] == 0.0
    once = driver.get(cv2.CAP_PROP_EXPOSURE)
    assert once == driver.get(cv2.CAP_PROP_EXPOSURE)


def test_a_driver_that_says_yes_and_does_nothing_is_found_out() -> None:
    refused = lock_settings(Driver(obeys=False))
    assert any("automatic exposure stays at 3" in text for text in refused)
    assert any("automatic white balance" in text for text in refused)
