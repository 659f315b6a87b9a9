"""Finding sequences, and never leaving the dataset's folder."""

from dataclasses import replace
from pathlib import Path

import pytest

from gmrdata.read.threedpw import read_sequence
from gmrdata.read.threedpw_files import find_sequence, find_sequences
from gmrdata.values.errors import BadSequence, MissingInput

NAME = "courtyard_walk_00"


def touch(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()


def test_sequences_of_the_three_splits_are_found_in_order(tmp_path):
    for where in ("test/b", "train/z", "train/a", "validation/c", "all/a", "test/.hidden"):
        touch(tmp_path / "sequenceFiles" / f"{where}.pkl")
    touch(tmp_path / "sequenceFiles" / "train" / "notes.txt")
    found = [(files.split, files.name) for files in find_sequences(tmp_path)]
    assert found == [("train", "a"), ("train", "z"), ("validation", "c"), ("test", "b")]
    files = find_sequence(tmp_path, "z")
    assert files.pickle_path == tmp_path / "sequenceFiles" / "train" / "z.pkl"
    assert files.image_path(7) == tmp_path / "imageFiles" / "z" / "image_00007.jpg"


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (None, "no such folder"),
        ("imageFiles/a/image_00000.jpg", "has no folder sequenceFiles"),
        ("sequenceFiles/all/a.pkl", "none of train, validation, test"),
        ("sequenceFiles/test/a.txt", r"no \.pkl in test"),
    ],
)
def test_what_is_missing_is_said(tmp_path, there, said):
    root = tmp_path / "3DPW"
    if there is not None:
        touch(root / there)
    with pytest.raises(MissingInput, match=said):
        find_sequences(root)


def test_unknown_names_and_names_of_two_splits_are_refused(tmp_path):
    touch(tmp_path / "sequenceFiles" / "train" / "a.pkl")
    touch(tmp_path / "sequenceFiles" / "test" / "a.pkl")
    with pytest.raises(MissingInput, match="no sequence 'b'"):
        find_sequence(tmp_path, "b")
    with pytest.raises(BadSequence, match="is in train and test"):
        find_sequence(tmp_path, "a")


@pytest.mark.parametrize("name", ["../a", "a/b", "..", "", ".a", "/etc/passwd", "a\\b", "a\n", "é"])
def test_names_that_are_paths_are_refused(tmp_path, name):
    touch(tmp_path / "sequenceFiles" / "train" / "a.pkl")
    with pytest.raises(BadSequence, match="no name of a sequence"):
        find_sequence(tmp_path, name)


@pytest.mark.parametrize(
    "linked",
    [
        "sequenceFiles",
        "sequenceFiles/train",
        f"sequenceFiles/train/{NAME}.pkl",
        f"imageFiles/{NAME}",
    ],
)
def test_links_out_of_the_root_are_not_followed(make_dataset, tmp_path, linked):
    root = make_dataset()
    outside = tmp_path / "outside"
    (root / linked).rename(outside)
    (root / linked).symlink_to(outside)
    with pytest.raises(BadSequence, match="link out of"):
        read_sequence(root, NAME)


def test_a_link_to_an_image_outside_is_a_missing_image(make_dataset, tmp_path):
    root = make_dataset()
    image = root / "imageFiles" / NAME / "image_00004.jpg"
    image.rename(tmp_path / "else.jpg")
    image.symlink_to(tmp_path / "else.jpg")
    faults = read_sequence(root, NAME).images.faults
    assert [row for row, fault in enumerate(faults) if fault] == [4]
    assert faults[4] == "image_00004.jpg is a link out of the dataset"


def test_links_inside_and_a_linked_root_are_fine(make_dataset, tmp_path):
    root = make_dataset()
    folder = root / "imageFiles" / NAME
    folder.rename(root / "images")
    folder.symlink_to(root / "images")
    (tmp_path / "link").symlink_to(root)
    assert read_sequence(tmp_path / "link", NAME).problems == ()


def test_a_circle_of_links_is_an_error(make_dataset):
    root = make_dataset()
    folder = root / "sequenceFiles" / "validation"
    folder.symlink_to(root / "other")
    (root / "other").symlink_to(folder)
    assert [files.split for files in find_sequences(root)] == ["train"]
    pickle_path = root / "sequenceFiles" / "train" / f"{NAME}.pkl"
    pickle_path.unlink()
    pickle_path.symlink_to(pickle_path)
    with pytest.raises((BadSequence, MissingInput)):
        read_sequence(root, NAME)


def test_a_file_that_says_another_name_is_a_problem(make_dataset, walk_arrays):
    root = make_dataset(replace(walk_arrays, name="other"))
    for folder, suffix in (("sequenceFiles/train", ".pkl"), ("imageFiles", "")):
        (root / folder / f"other{suffix}").rename(root / folder / f"{NAME}{suffix}")
    assert read_sequence(root, NAME).problems == ("the file says that it is sequence 'other'",)
