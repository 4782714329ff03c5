"""The distribution's own package sources are found in both of apt's forms; others are left alone."""

from __future__ import annotations

import platform
import shutil
from pathlib import Path

import private_apt
import pytest

DEB822 = """\
# What an image of Debian comes with.
Types: deb
URIs: http://mirror.example/debian
Suites: bookworm bookworm-updates
Components: main
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg

Types: deb
URIs: http://mirror.example/node
Suites: nodistro
Components: main
"""
ONE_LINE = """\
deb http://mirror.example/debian bookworm main contrib
deb [arch=amd64 signed-by=/k.gpg] http://mirror.example/security bookworm-security main  # by hand
deb http://mirror.example/docker bookworm stable
deb-src http://mirror.example/debian bookworm main
#deb http://mirror.example/old bookworm main
"""


@pytest.fixture(autouse=True)
def debian(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(platform, "freedesktop_os_release", lambda: {"VERSION_CODENAME": "bookworm"})


def lines(folder: Path) -> list[str]:
    return private_apt.read_sources(folder).text.splitlines()


def test_sources_in_stanzas_gain_the_backports(tmp_path: Path) -> None:
    (tmp_path / "sources.list.d").mkdir()
    (tmp_path / "sources.list.d" / "debian.sources").write_text(DEB822)
    start = "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://mirror.example/debian"
    assert lines(tmp_path) == [
        f"{start} bookworm main",
        f"{start} bookworm-updates main",
        f"{start} bookworm-backports main",
    ]


def test_sources_in_lines_gain_the_backports_and_keep_their_options(tmp_path: Path) -> None:
    (tmp_path / "sources.list").write_text(ONE_LINE)
    assert lines(tmp_path) == [
        "deb http://mirror.example/debian bookworm main",
        "deb http://mirror.example/debian bookworm-backports main",
        "deb [arch=amd64 signed-by=/k.gpg] http://mirror.example/security bookworm-security main",
    ]


def test_a_machine_without_such_sources_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(private_apt.AptUnavailable, match="no package source for the release 'bookworm'"):
        private_apt.read_sources(tmp_path)


def test_a_system_without_apt_is_told_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(private_apt.AptUnavailable, match="no apt-get"):
        private_apt.read_sources(tmp_path)


def test_every_write_of_apt_stays_in_its_folder(tmp_path: Path) -> None:
    text = private_apt._configuration(tmp_path)
    for setting in ("Dir::State::lists", "Dir::Cache", "Dir::Etc::sourcelist", "Dir::Log"):
        assert f'{setting} "{tmp_path}' in text
    assert "#clear APT::Update::Post-Invoke;" in text
