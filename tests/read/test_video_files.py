"""Which videos a batch is of, and whose poses are whose."""

from pathlib import Path

import pytest

from gmrdata.read.video_files import FoundVideos, NamedVideo, find_videos, with_poses
from gmrdata.values.errors import BadMotionFile, BadRecipe, MissingInput


def filled(folder: Path, *names: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"x" * len(name))
    return folder


def test_one_video_is_no_batch(tmp_path):
    images = filled(tmp_path / "frames", "0.jpg", "1.jpg")
    odd = filled(tmp_path, "...mp4") / "...mp4"
    assert find_videos([images]) is None and find_videos([odd]) is None
    assert find_videos([filled(tmp_path / "empty", "notes.txt")]) is None
    with pytest.raises(MissingInput, match="gone: no such video"):
        find_videos([images, tmp_path / "gone"])


def test_files_of_folders_and_folders_of_images_are_videos(tmp_path):
    clips = filled(tmp_path / "clips", "b.mp4", "a b.MOV", ".hidden.mp4", "notes.txt")
    filled(clips / "more", "c.mp4")
    images = filled(tmp_path / "frames.d", "0.jpg", "10.jpg")
    named = filled(tmp_path, "strange") / "strange"
    found = find_videos([clips, images, named, clips / "b.mp4"])
    assert found is not None
    assert [(video.name, video.path) for video in found.videos] == [
        ("a b", clips / "a b.MOV"), ("b", clips / "b.mp4"),
        ("frames.d", images), ("strange", named),
    ]  # fmt: skip
    assert found.remarks == (
        f"{clips}: 2 that are not named as videos are left out: more, notes.txt",
    )
    alone = find_videos([filled(tmp_path / "one", "b.mp4")])  # a folder of videos that has one yet
    assert alone is not None and [video.name for video in alone.videos] == ["b"]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("a.mp4", "0.jpg"), r"videos \(a.mp4\) and images \(0.jpg\). Put them into two folders"),
        (("a.mp4", "a.mov"), r"a.mov and .*a.mp4 would both be video a. Rename one"),
        (("...mp4",), "Rename it"),
        (("a.partial.mp4",), "Rename it"),
        (("a\n.mp4",), "Rename it"),
        (("a\udcff.mp4",), "Rename it"),
        ((f"{151 * 'a'}.mp4",), "150 bytes at most"),
    ],
)
def test_what_can_be_no_batch_is_refused(names, said, tmp_path):
    clips = filled(tmp_path / "clips", *names)
    sources = [clips / names[0], clips / names[0]] if names[0].startswith(".") else [clips]
    with pytest.raises(BadRecipe, match=said):
        find_videos(sources)


def found(*names: str) -> FoundVideos:
    return FoundVideos(tuple(NamedVideo(name, Path(f"/{name}.mp4")) for name in names), ())


def test_poses_are_found_by_name_as_systems_leave_them(tmp_path):
    folder = filled(tmp_path / "poses", "a.pkl", "b.PT", "nobody.pkl", "notes.txt")
    filled(folder / "c", "wham_output.pkl", "slam.pth")
    filled(folder / "d", "camera.npy")
    given = with_poses(found("a", "b", "c", "d", "e"), folder)
    assert [video.poses_path for video in given.videos] == [
        folder / "a.pkl", folder / "b.PT", folder / "c" / "wham_output.pkl", folder / "d", None,
    ]  # fmt: skip
    assert given.remarks == (
        f"{folder}: 1 of 5 videos have no poses and end in cameras alone: e",
        f"{folder}: poses that belong to no video: nobody",
    )


def test_phalps_and_gems_files_are_found_by_the_names_that_they_have(tmp_path):
    """PHALP puts the results of all videos into one folder, its own word first."""
    folder = filled(tmp_path / "poses", "demo_a.pkl", "b.pkl", "demo_b.pkl")
    for name in ("c/hpe_results.pt", "d/preprocess/hpe_results.pt", "e/smpl_params.pt"):
        filled((folder / name).parent, Path(name).name)
    given = with_poses(found("a", "b", "c", "d", "e"), folder)
    assert [str(video.poses_path)[len(str(folder)) + 1 :] for video in given.videos] == [
        "demo_a.pkl", "b.pkl", "c/hpe_results.pt", "d/preprocess/hpe_results.pt",
        "e/smpl_params.pt",
    ]  # fmt: skip
    assert given.remarks == (f"{folder}: poses that belong to no video: demo_b",)


@pytest.mark.parametrize(
    ("names", "error", "said"),
    [
        (("a.pkl", "a.pt"), BadRecipe, "a.pkl and .*a.pt are both poses of video a"),
        (("b.pkl",), MissingInput, "holds poses of none of the 1 videos. Name them .* like a.pkl"),
        (
            ("a/vibe_output.pkl", "a/wham_output.pkl"),
            BadMotionFile,
            "Leave the poses of one system",
        ),
    ],
)
def test_poses_that_nobody_can_tell_apart_are_refused(names, error, said, tmp_path):
    for name in names:
        filled((tmp_path / "poses" / name).parent, Path(name).name)
    with pytest.raises(error, match=said):
        with_poses(found("a"), tmp_path / "poses")
    with pytest.raises(BadRecipe, match="one video alone"):
        with_poses(found("a"), tmp_path / "poses" / names[0])
