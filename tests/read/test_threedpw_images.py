"""Images of a sequence: missing, broken, of another size or orientation."""

from dataclasses import replace

import numpy as np
import pytest

from gmrdata.read.threedpw import read_sequence
from gmrdata.read.threedpw_files import SequenceArrays
from gmrdata.values.errors import BadFrames, BadSequence, MissingInput
from gmrdata.write.threedpw import write_sequence

NAME = "courtyard_walk_00"


def with_centre(arrays: SequenceArrays, x_px: float, y_px: float) -> SequenceArrays:
    intrinsics_px = arrays.intrinsics_px.copy()
    intrinsics_px[:2, 2] = x_px, y_px
    return replace(arrays, intrinsics_px=intrinsics_px)


def test_the_size_is_that_of_the_images(make_dataset):
    sequence = read_sequence(make_dataset(), NAME)
    assert (sequence.images.width_px, sequence.images.height_px) == (90, 160)
    assert sequence.problems == () and set(sequence.images.faults) == {""}


def test_rows_belong_to_images_by_number_and_not_by_img_frame_ids(make_dataset):
    sequence = read_sequence(make_dataset(), NAME)
    assert sequence.arrays.img_frame_ids.tolist() == list(range(0, 60, 2))
    assert [path.name for path in sequence.images.paths[:3]] == [
        "image_00000.jpg",
        "image_00001.jpg",
        "image_00002.jpg",
    ]


def test_landscape_sequences_are_read(make_dataset, walk_arrays):
    root = make_dataset(with_centre(walk_arrays, 80.0, 45.0), size_px=(160, 90))
    images = read_sequence(root, NAME).images
    assert (images.width_px, images.height_px) == (160, 90)


def test_broken_images_are_faults_of_their_rows(make_dataset, jpeg):
    root = make_dataset()
    folder = root / "imageFiles" / NAME
    whole = jpeg(90, 160)
    (folder / "image_00003.jpg").unlink()
    (folder / "image_00007.jpg").write_bytes(b"")
    (folder / "image_00008.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "image_00009.jpg").write_bytes(b"GIF89a")
    (folder / "image_00029.jpg").write_bytes(jpeg(160, 90))
    (folder / "image_00030.jpg").write_bytes(whole)
    sequence = read_sequence(root, NAME)
    faults = {row: fault for row, fault in enumerate(sequence.images.faults) if fault}
    assert faults == {
        3: "image_00003.jpg is missing",
        7: "image_00007.jpg is empty (0 bytes)",
        8: "image_00008.jpg is truncated or no image",
        9: "image_00009.jpg is truncated or no image",
        29: "image of 160x90 px, others have 90x160 px",
    }
    assert sequence.images.spare == (30,)
    assert sequence.problems == ("5 of 30 images can't be used", "1 images beyond the last row")


def test_no_images_at_all(make_dataset):
    root = make_dataset()
    folder = root / "imageFiles" / NAME
    for path in folder.iterdir():
        path.write_bytes(b"")
    with pytest.raises(BadFrames, match="not one image can be used"):
        read_sequence(root, NAME)
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    with pytest.raises(MissingInput, match=r"unpack 3DPW's imageFiles\.zip"):
        read_sequence(root, NAME)


@pytest.mark.parametrize(
    ("x_px", "y_px", "said"),
    [
        (80.0, 45.0, "that of the other orientation"),
        (540.0, 960.0, "that of other images"),
        (45.0, 20.0, "that of other images"),
    ],
)
def test_intrinsics_of_other_images_are_refused(make_dataset, walk_arrays, x_px, y_px, said):
    root = make_dataset(with_centre(walk_arrays, x_px, y_px))
    with pytest.raises(
        BadSequence, match=rf"{NAME}\.pkl: cam_intrinsics .*90x160 px: it is {said}"
    ):
        read_sequence(root, NAME)


def with_second(arrays: SequenceArrays, **changes: object) -> SequenceArrays:
    return replace(arrays, people=(arrays.people[0], replace(arrays.people[1], **changes)))  # type: ignore[arg-type]


def test_odd_60_hz_arrays_are_problems_and_no_errors(make_dataset, walk_arrays):
    poses, trans = walk_arrays.people[1].poses_60hz_rad, walk_arrays.people[1].trans_60hz_m
    assert poses is not None and trans is not None
    cases = (
        (with_second(walk_arrays, poses_60hz_rad=poses[:40]), "poses_60Hz has 40 rows"),
        (
            with_second(walk_arrays, poses_60hz_rad=poses[:40], trans_60hz_m=trans[:40]),
            "img_frame_ids goes to 58, poses_60Hz has 40 rows",
        ),
        (with_second(walk_arrays, poses_60hz_rad=poses[::-1]), "doesn't lead from poses_60Hz"),
        (replace(walk_arrays, img_frame_ids=np.arange(30)), "doesn't lead from poses_60Hz"),
    )
    root = make_dataset()
    for arrays, said in cases:
        write_sequence(root, "train", arrays)
        problems = read_sequence(root, NAME).problems
        assert problems and all(said in problem for problem in problems)
        assert "person 1" in problems[-1]
