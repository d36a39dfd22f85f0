"""What a run looks like: figures, a video and one page that holds them all.

    write_report(run_directory)          # report.html, figures/*.svg, video/*.mp4
    robot_picture(load_robot("crawler"), "crawler.svg")

Everything here reads what a run has left behind (`reading`) and changes none of it; every number and every
sentence on the page is made from those files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testbed.report.page import write_report
    from testbed.report.pictures import robot_picture

__all__ = ["robot_picture", "write_report"]


def __getattr__(name: str) -> Any:
    # matplotlib takes half a second to import: only those who draw pay for it.
    if name == "write_report":
        from testbed.report.page import write_report

        return write_report
    if name == "robot_picture":
        from testbed.report.pictures import robot_picture

        return robot_picture
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
