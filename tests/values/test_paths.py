"""No path that a file names may lead out of its folder."""

import os
from pathlib import PurePosixPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.values.files import resolve_inside, safe_relative, sha256_of_path


@given(text=st.text(st.sampled_from("ab./\\:~\n \0é"), max_size=10))
def test_what_passes_stays_below(text):
    try:
        safe = safe_relative(text)
    except ValueError:
        return
    assert safe == text
    parts = PurePosixPath(text).parts
    assert parts
    assert ".." not in parts
    assert "/" not in parts


@pytest.mark.parametrize("text", ["a", "a/b.c", "a b/ü", "...", "~/x", "-rf"])
def test_plain_paths_pass(text):
    assert safe_relative(text) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        ".",
        "/a",
        "a/..",
        "..",
        "a/./b",
        "a/",
        "a//b",
        "C:a",
        "a\0b",
        "x" * 256,
        "a/" + "é" * 128,
        "a/" * 500 + "b",
    ],
)
def test_others_do_not(text):
    with pytest.raises(ValueError, match="path"):
        safe_relative(text)


def test_link_to_a_neighbour_whose_name_begins_alike(tmp_path):
    """`/set` is not above `/settings`, although the text of one begins with the other."""
    (tmp_path / "set").mkdir()
    (tmp_path / "settings").mkdir()
    (tmp_path / "set" / "link").symlink_to(tmp_path / "settings")
    with pytest.raises(ValueError, match="link out"):
        resolve_inside(tmp_path / "set", "link/x")


def test_root_that_is_itself_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "x").write_text("x")
    (tmp_path / "root").symlink_to(tmp_path / "real")
    assert resolve_inside(tmp_path / "root", "x") == (tmp_path / "real" / "x").resolve()


def test_a_folder_has_a_hash_where_the_bytes_of_a_name_are_no_utf_8(tmp_path):
    """Such a name beside the frames, as zip files of Windows unpack them, ended in a traceback."""
    before = sha256_of_path(tmp_path)
    (tmp_path / os.fsdecode(b"\xfcbung.txt")).write_bytes(b"")
    assert sha256_of_path(tmp_path) != before
