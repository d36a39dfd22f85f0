"""Files are written whole or not at all."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from testbed.errors import UserError
from testbed.experiment.atomic import write_text


def test_a_file_that_cannot_be_written_whole_is_not_there(tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    write_text(file, "old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(UserError, match=r"disk is full.*every finished trial is kept"):
            write_text(file, "new" * 1000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert file.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_a_file_is_replaced_in_one_step_never_rewritten(tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    write_text(file, "old")
    with file.open() as reader:  # whoever had it open goes on reading the old file, whole
        write_text(file, "new")
        assert reader.read() == "old"
    assert file.read_text() == "new"
