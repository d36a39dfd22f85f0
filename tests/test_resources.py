from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from testbed import resources
from testbed.errors import UserError


def test_every_name_has_its_file() -> None:
    assert {"crawler", "splayed"} <= set(resources.robot_names())
    assert "whom_to_imitate" in resources.scenario_names()
    for name in resources.robot_names():
        assert resources.robot_path(name).stem == name
    for name in resources.scenario_names():
        assert resources.scenario_path(name).is_file()


@pytest.mark.parametrize("name", ["crawlr", "../robots/crawler", "", "crawler.yaml", "a\0b"])
def test_an_unknown_name_is_a_user_error(name: str) -> None:
    with pytest.raises(UserError, match="unknown robot"):
        resources.robot_path(name)


def test_only_what_can_be_read_is_a_shipped_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots").mkdir()
    for name in ("mine.yaml", "other.urdf"):
        (tmp_path / "robots" / name).touch()
    monkeypatch.setattr(resources, "data_root", lambda: tmp_path)
    assert resources.robot_names() == ("mine",)


def test_an_installed_package_finds_its_own_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "site-packages" / "testbed"
    shutil.copytree(resources.data_root() / "robots", package / "_data" / "robots")
    (tmp_path / "site-packages" / "robots").mkdir()  # somebody else's package of that name
    monkeypatch.setattr(resources, "_PACKAGE", package)
    assert "crawler" in resources.robot_names()
    assert package in resources.robot_path("crawler").parents
    assert resources.scenario_names() == ()
