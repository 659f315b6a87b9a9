"""The tables, by the command line: one bad sequence does not stop the others."""

import os
import pickle  # noqa: TID251  The test writes a hostile pickle.
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.threedpw_files import SequenceArrays, SequenceFiles
from gmrdata.threedpw.regenerate import range_rows, sequence_rows
from gmrdata.values.errors import BadRecipe
from gmrdata.write.threedpw import write_sequence

NAME = "courtyard_walk_00"
Make = Callable[..., Path]


def gmrdata(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *map(str, arguments)]
    environment = os.environ | {"COLUMNS": "240"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture
def mixed_root(
    make_dataset: Make, walk_arrays: SequenceArrays, jpeg: Callable[[int, int], bytes]
) -> Path:
    """A good sequence, one with oddities, and five that can't be read."""
    root = make_dataset()
    odd = replace(walk_arrays, name="odd_00", people=walk_arrays.people[:1])
    files = write_sequence(root, "test", odd)
    files.image_dir.mkdir()
    for row in range(27):
        files.image_path(row).write_bytes(jpeg(90, 160))
    write_sequence(root, "test", replace(walk_arrays, name="no_images_00"))
    test_dir = root / "sequenceFiles" / "test"
    (test_dir / "empty_00.pkl").write_bytes(b"")
    (test_dir / "hostile_00.pkl").write_bytes(b"cos\nsystem\n(S'exit'\ntR.")
    (test_dir / "[red]\x1b[2J.pkl").write_bytes(pickle.dumps({}))
    (test_dir / f"{NAME}.pkl").write_bytes(b"")
    return root


def test_the_list_shows_every_sequence_and_ends_with_1(mixed_root: Path) -> None:
    answer = gmrdata("threedpw", "list", "--threedpw", mixed_root)
    assert answer.returncode == 1
    assert "Traceback" not in answer.stderr
    assert "6 of 7 sequences can't be used, see the table" in " ".join(answer.stderr.split())
    said = " ".join(answer.stdout.split())
    assert said.startswith("sequence split people frames size [px] usable problems")
    assert "1 (female) 30 90x160 80.0 %" in said
    for text in ("truncated or not a pickle", "system", "no name of a sequence",
                 "is in train and test", "unpack 3DPW's imageFiles.zip",
                 "3 of 30 images can't be used"):  # fmt: skip
        assert text in said.replace("\n", " "), text
    assert "\x1b" not in answer.stdout


def test_rows_of_good_and_odd_sequences(mixed_root: Path) -> None:
    rows, n_bad = sequence_rows(mixed_root, "campose_valid")
    assert n_bad == 6
    by_name = {row[0]: row for row in rows if row[2] != "-"}
    assert by_name == {
        "odd_00": ("odd_00", "test", "1 (female)", "30", "90x160", "80.0 %",
                   "3 of 30 images can't be used"),
    }  # fmt: skip
    (mixed_root / "sequenceFiles" / "test" / f"{NAME}.pkl").unlink()
    rows, n_bad = sequence_rows(mixed_root, "campose_valid")
    assert rows[0] == (
        NAME, "train", "2 (female, male)", "30", "90x160", "90.0 %, 100.0 %", "",
    )  # fmt: skip
    assert n_bad == 4


def test_a_good_folder_ends_with_0(make_dataset: Make) -> None:
    answer = gmrdata("threedpw", "list", "--threedpw", make_dataset())
    assert answer.returncode == 0, answer.stderr
    assert "90.0 %, 100.0 %" in answer.stdout


def test_show_gives_the_ranges_and_reasons_of_each_person(
    make_dataset: Make, walk_arrays: SequenceArrays
) -> None:
    root = make_dataset()
    SequenceFiles(root, NAME, "train").image_path(29).unlink()
    rows, problems = range_rows(root, NAME, "campose_valid")
    assert rows == [
        ("0", "female", "0", "29", "26", "86.7 %"),
        ("0", "female", "10", "12", "3", "campose_valid is 0"),
        ("0", "female", "29", "29", "1", "image_00029.jpg is missing"),
        ("1", "male", "0", "29", "29", "96.7 %"),
        ("1", "male", "29", "29", "1", "image_00029.jpg is missing"),
    ]
    assert problems == ("1 of 30 images can't be used",)
    answer = gmrdata("threedpw", "show", NAME, "--threedpw", root)
    assert answer.returncode == 0, answer.stderr
    assert "campose_valid is 0" in answer.stdout and "1 of 30 images" in answer.stdout


def test_rules_change_the_share_and_unknown_ones_are_refused(
    make_dataset: Make, walk_arrays: SequenceArrays
) -> None:
    undetected = replace(
        walk_arrays.people[1],
        poses2d_px=np.where(
            np.arange(30)[:, None, None] < 15, 0.0, walk_arrays.people[1].poses2d_px
        ),
    )
    root = make_dataset(replace(walk_arrays, people=(walk_arrays.people[0], undetected)))
    shares = {rule: sequence_rows(root, rule)[0][0][5] for rule in ("glamr", "vibe")}
    assert shares["glamr"] == "90.0 %, 50.0 %"
    assert shares["vibe"] == "100.0 %, 50.0 %"
    with pytest.raises(BadRecipe, match="no rule 'best'"):
        sequence_rows(root, "best")
