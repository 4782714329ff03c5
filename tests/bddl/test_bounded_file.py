"""Reading of a file that a person named ends: by its kind, by its size, or by its end."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from bddl.files import read_bounded, read_bounded_text


def test_the_largest_file_is_read_and_a_larger_one_is_not(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"x" * 100)
    assert read_bounded(file, 100) == b"x" * 100
    with pytest.raises(OSError) as caught:
        read_bounded(file, 99)
    assert caught.value.errno == errno.EFBIG and caught.value.filename == str(file)


def test_a_pipe_without_a_writer_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="no regular file"):
        read_bounded(tmp_path / "pipe")


def test_where_a_pipe_will_do_it_is_read_to_its_end(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.write(writing, b"text")
    os.close(writing)
    try:
        assert read_bounded(f"/dev/fd/{reading}", pipes=True) == b"text"
    finally:
        os.close(reading)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/urandom"])
def test_a_device_is_refused_and_has_an_end_where_pipes_will_do(name: str) -> None:
    with pytest.raises(OSError, match="no regular file"):
        read_bounded(name)
    with pytest.raises(OSError, match="larger than 8 MB"):
        read_bounded(name, pipes=True)


def test_a_folder_and_a_name_that_no_file_has_are_errors_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        read_bounded(tmp_path)
    with pytest.raises(OSError, match="no file has such a name"):
        read_bounded("a\0b")


def test_text_comes_without_mark_and_with_plain_line_ends(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"\xef\xbb\xbfone\r\ntwo\rthree\n")
    assert read_bounded_text(tmp_path / "file") == "one\ntwo\nthree\n"
