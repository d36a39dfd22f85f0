"""Cameras as streams: Motion JPEG over HTTP on this machine alone, as cheap network cameras have it."""

from __future__ import annotations

import contextlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2

from testbed.hardware.rig.cameras import Image

_BOUNDARY = "frame"
_QUALITY = 95  # of JPEG; less would add more to the picture than the sensor's noise does
_PATIENCE = 5.0  # s


class Streams:
    """A server of one stream a name, at ``http://127.0.0.1:<port>/<name>``. Close it in the end.

    Args:
        names: What the streams are called.
        port: Where; any free one if 0.

    Raises:
        OSError: If the port is taken.
    """

    def __init__(self, names: tuple[str, ...], port: int = 0) -> None:
        self._newest: dict[str, tuple[int, bytes]] = dict.fromkeys(names, (0, b""))
        self._came = threading.Condition()
        self._closed = False
        self._server = ThreadingHTTPServer(("127.0.0.1", port), self._handler())
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="streams", daemon=True)
        self._thread.start()

    def address(self, name: str) -> str:
        """Where a stream is."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/{name}"

    def show(self, images: dict[str, Image]) -> None:
        """Give everybody who watches the next frame of each stream, all at the same time."""
        coded = {
            name: cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
            for name, image in images.items()
        }
        with self._came:
            for name, data in coded.items():
                self._newest[name] = (self._newest[name][0] + 1, data)
            self._came.notify_all()

    def close(self) -> None:
        """End all streams; harmless when repeated."""
        with self._came:
            self._closed = True
            self._came.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(_PATIENCE)

    def _next(self, name: str, seen: int) -> tuple[int, bytes] | None:
        """The newest frame once it is another one than that of number ``seen``; None when it is over."""
        with self._came:
            self._came.wait_for(lambda: self._closed or self._newest[name][0] > seen, _PATIENCE)
            return None if self._closed else self._newest[name]

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        streams = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                name = self.path.strip("/")
                if name not in streams._newest:
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
                self.end_headers()
                with contextlib.suppress(OSError):  # whoever watched has gone
                    self._stream(name)

            def _stream(self, name: str) -> None:
                seen = 0
                while (frame := streams._next(name, seen)) is not None:
                    if frame[0] == seen:
                        continue
                    seen, data = frame
                    head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                    self.wfile.write(head.encode() + data + b"\r\n")

            def log_message(self, format: str, *args: Any) -> None:
                """Nobody reads a log of requests."""

        return Handler
