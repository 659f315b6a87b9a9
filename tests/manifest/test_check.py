"""Every way in which a data set can differ from its manifest is found, and said in words."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.listing import file_record, folder_record
from gmrdata.manifest.read import load_clips, read_manifest
from gmrdata.manifest.write import ClipFiles, clip_entry, write_manifest
from gmrdata.values.clip import Joints2d, save_clip, save_joints
from gmrdata.values.errors import BadManifest, MissingInput
from tests.clip_manifests import Edit, a_head, a_walk

WALK = 1
"""Clips are written in order of id: bare, walk."""


def refused(path: Path, *words: str, hashes: bool = True) -> str:
    with pytest.raises(BadManifest) as caught:
        check_manifest(path, hashes=hashes)
    message = str(caught.value)
    for word in (str(path), *words):
        assert word in message
    return message


def rehash(data_set: Path, edit: Edit) -> Path:
    """Make the manifest agree with changed files of walk, so that only their content is wrong."""

    def change(data: dict) -> None:
        walk = data["clips"][WALK]
        for record in (walk["arrays"], walk["images"]["listing"]):
            content = (data_set / record["path"]).read_bytes()
            record["sha256"] = hashlib.sha256(content).hexdigest()
            record["size_bytes"] = len(content)

    return edit(change)


def arrays_of(data_set: Path) -> dict[str, np.ndarray]:
    with np.load(data_set / "clips" / "walk.npz") as archive:
        return dict(archive)


def with_arrays(data_set: Path, edit: Edit, **changed: np.ndarray) -> Path:
    arrays = arrays_of(data_set)
    np.savez(data_set / "clips" / "walk.npz", **(arrays | changed))
    return rehash(data_set, edit)


def save_places(data_set: Path, n_rows: int) -> None:
    places_m, yes = np.zeros((n_rows, 24, 3)), np.ones((n_rows, 24), bool)
    joints = Joints2d(places_m, places_m, places_m[..., :2], yes, yes)
    save_joints(data_set / "joints.npz", joints)


EXTRAS = ("depth", "normals", "flow", "instances")


def with_extras(data_set: Path) -> Path:
    """The data set again, with all that a clip may have besides; row 5, the last, no flow."""
    for name in EXTRAS:
        (data_set / name).mkdir()
        for number in range(6 - (name == "flow")):
            (data_set / name / f"{number:05d}.png").write_bytes(b"%d" % number)
    save_places(data_set, 6)
    (data_set / "video.mp4").write_bytes(b"a video")
    (data_set / "passer_by_1.npz").write_bytes(b"someone")
    (data_set / "car_1.npz").write_bytes(b"a car")
    files = ClipFiles(
        data_set / "clips" / "walk.npz",
        images=data_set / "frames",
        masks=data_set / "masks",
        extras=[data_set / "passer_by_1.npz", data_set / "car_1.npz"],
        joints=data_set / "joints.npz",
        video=data_set / "video.mp4",
        **{name: data_set / name for name in EXTRAS},
    )
    entry = clip_entry(data_set, files, a_walk())
    return write_manifest(data_set / "more.yaml", a_head("more"), [entry])


def test_passes_joints_and_video_are_listed_and_checked(data_set):
    path = with_extras(data_set)
    check_manifest(path)
    walk = read_manifest(path).clips[0]
    assert [getattr(walk, name).count for name in EXTRAS] == [6, 6, 5, 6]
    assert [(extra.instance, extra.arrays.path) for extra in walk.extras] == [
        (2, "passer_by_1.npz"),
        (3, "car_1.npz"),
    ]
    (data_set / "car_1.npz").write_bytes(b"a bus")
    (data_set / "passer_by_1.npz").unlink()
    (data_set / "depth" / "00001.png").write_bytes(b"7")
    (data_set / "flow" / "00002.png").unlink()
    (data_set / "video.mp4").write_bytes(b"another")
    refused(
        path,
        "clip walk: depth: depth/00001.png has sha256",
        "clip walk: flow: flow/00002.png is missing",
        "clip walk: video: video.mp4 has sha256",
        "clip walk: extras[0].arrays: passer_by_1.npz is missing",
        "clip walk: extras[1].arrays: car_1.npz has sha256",
    )


def test_passes_of_other_images_are_found(data_set):
    with_extras(data_set)
    (data_set / "flow" / "00001.png").rename(data_set / "flow" / "00009.png")
    (data_set / "normals" / "00005.png").unlink()
    walk_only = read_manifest(data_set / "more.yaml").clips[0]
    save_places(data_set, 3)
    changed = {name: folder_record(data_set, data_set / name) for name in EXTRAS}
    changed["joints"] = file_record(data_set, data_set / "joints.npz")
    wrong = walk_only.model_copy(update=changed)
    path = write_manifest(data_set / "wrong.yaml", a_head("wrong"), [wrong])
    refused(
        path,
        "flow.folder: 00009.png belongs to no image",
        "flow.folder: none of number 1,",
        "normals.folder: none of number 5,",
        "joints: 3 rows, the clip has 6",
    )


def test_a_data_set_passes_also_where_it_is_moved(finished_data_set, data_set):
    check_manifest(finished_data_set / "set.yaml")
    check_manifest(finished_data_set / "set.yaml", hashes=False)
    check_manifest(data_set / "set.yaml")
    assert [clip.id for clip in load_clips(data_set / "set.yaml")] == ["bare", "walk"]


def test_no_manifest(tmp_path):
    with pytest.raises(MissingInput, match=r"nothing\.yaml"):
        check_manifest(tmp_path / "nothing.yaml")


def test_changed_byte(data_set):
    image = data_set / "frames" / "00003.jpg"
    content = bytearray(image.read_bytes())
    content[-3] ^= 1
    image.write_bytes(content)
    refused(data_set / "set.yaml", "clip walk", "images", "frames/00003.jpg has sha256", "copy it")
    check_manifest(data_set / "set.yaml", hashes=False)  # the size is right


def test_changed_size_is_found_without_hashing(data_set):
    with (data_set / "masks" / "00001.png").open("ab") as stream:
        stream.write(b"x")
    refused(data_set / "set.yaml", "masks", "masks/00001.png has", "bytes, not", hashes=False)


def link_out(path: Path) -> None:
    """Move a file or folder out of the data set, and leave a link to it."""
    data_set = next(above for above in path.parents if (above / "set.yaml").is_file())
    path.symlink_to(path.rename(data_set.parent / path.name))


def link_in_a_circle(path: Path) -> None:
    path.unlink()
    path.symlink_to("walk2.npz")
    path.with_name("walk2.npz").symlink_to("walk.npz")


def make_a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("frames/00002.jpg", Path.unlink, ("clip walk", "frames/00002.jpg is missing")),
        ("clips/walk.npz", Path.unlink, ("clip walk", "clips/walk.npz is missing")),
        ("listings/frames.tsv", Path.unlink, ("clip walk", "listings/frames.tsv is missing")),
        ("masks", lambda path: path.rename(path.with_name("elsewhere")),
         ("clip walk: masks.folder", "no such folder")),
        ("frames/00006.jpg", lambda path: path.write_bytes(b"not listed"),
         ("images.folder: 00006.jpg not in the listing",)),
        ("clips", link_out, ("clip walk: arrays.path", "clip bare: arrays.path", "link out")),
        ("frames", link_out, ("clip walk: images.folder", "link out")),
        ("frames/00004.jpg", link_out, ("images.folder: path '00004.jpg'", "link out")),
        ("clips/walk.npz", link_in_a_circle, ("clip walk: arrays",)),
        # It is not waited for.
        ("clips/walk.npz", make_a_pipe, ("clip walk: arrays: clips/walk.npz is missing",)),
    ],
)  # fmt: skip
def test_files_that_are_not_as_they_were(name, damage, said, data_set):
    damage(data_set / name)
    refused(data_set / "set.yaml", *said)


EDITED = {"stage": "render", "config": {"seed": 1}, "inputs": {}, "sha256": "0" * 64}


@pytest.mark.parametrize(
    ("clip", "changed", "said"),
    [
        (WALK, {"arrays": {"sha256": "0" * 64}},
         ("clip walk: arrays: clips/walk.npz has sha256", "not " + "0" * 64)),
        (WALK, {"images": {"count": 7}}, ("images: the listing has 6 files", "not 7")),
        (WALK, {"kept": [{"start": 0, "stop": 6}], "dropped": []},
         ("clip walk: kept: row 2 not valid in the file",)),
        (0, {"camera_motion": "panning"},
         ("clip bare: camera_motion: is panning, but the file has no camera",)),
        (WALK, {"recipe": EDITED}, ("clip walk: recipe.sha256",)),
    ],
)  # fmt: skip
def test_entries_that_say_otherwise_than_the_files(clip, changed, said, edit):
    def change(data: dict) -> None:
        entry = data["clips"][clip]
        for key, value in changed.items():
            entry[key] = entry[key] | value if isinstance(entry.get(key), dict) else value

    refused(edit(change), *said)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"betas": np.array([{"a": 1}], dtype=object)},
         ("clip walk: arrays", "not a readable .npz of plain arrays")),
        ({"image_numbers": np.array([0, 1, -1, 4, 3, 5])},
         ("arrays.image_numbers: not increasing",)),
        ({"image_numbers": np.array([0, 1, 2, 3, 4, 9])},
         ("images.folder: none of number 9, which a row names",)),
        ({"camera_intrinsics_px": np.array([[-50.0, 0, 32], [0, 50, 24], [0, 0, 1]])},
         ("arrays.camera_intrinsics_px",)),
    ],
)  # fmt: skip
def test_arrays_that_cannot_be(arrays, said, data_set, edit):
    refused(with_arrays(data_set, edit, **arrays), *said)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"{'0' * 64}\t12\t../../secret\n", "climbs out"),
        (f"{'0' * 64}\t12\t/etc/hosts\n", "absolute"),
        (f"{'0' * 64}  12  00000.jpg\n", "not 'sha256 <tab> size <tab> path'"),
        (f"{'0' * 64}\t12\t00000.jpg\n", "repeated or out of order"),
        (None, "truncated"),
    ],
)
def test_hostile_listing(data_set, edit, line, said):
    listing = data_set / "listings" / "frames.tsv"
    whole = listing.read_text()
    listing.write_text(whole[:-1] if line is None else whole + line)
    at = () if line is None else ("frames.tsv:7",)
    refused(rehash(data_set, edit), "images.listing", *at, said)


def test_file_that_is_a_link_out(data_set, tmp_path):
    clip = data_set / "clips" / "walk.npz"
    clip.rename(tmp_path / "walk.npz")
    clip.symlink_to(tmp_path / "walk.npz")
    refused(data_set / "set.yaml", "clip walk: arrays.path", "link out of the manifest's folder")
    with pytest.raises(BadManifest, match="clip walk: arrays.path"):
        load_clips(data_set / "set.yaml")


def test_a_link_that_stays_inside_is_fine(data_set):
    (data_set / "clips").rename(data_set / "store")
    (data_set / "clips").symlink_to("store")
    check_manifest(data_set / "set.yaml")


def test_truncated_npz(data_set, edit):
    clip = data_set / "clips" / "walk.npz"
    clip.write_bytes(clip.read_bytes()[:2000])
    refused(rehash(data_set, edit), "clip walk: arrays", "not a readable .npz")


@pytest.mark.parametrize("key", ["poses", "trans"])
def test_nan_in_a_kept_row(data_set, edit, key):
    values = arrays_of(data_set)[key]
    values[4, 1] = np.nan
    path = with_arrays(data_set, edit, **{key: values})
    refused(path, f"arrays.{key}: NaN or infinite in kept row 4", "drop the rows")


def test_nan_in_a_dropped_row_is_fine(data_set, edit):
    arrays = arrays_of(data_set)
    arrays["poses"][2], arrays["trans"][2] = np.nan, np.inf
    check_manifest(with_arrays(data_set, edit, **arrays))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (np.diag([-1.0, 1, 1, 1]), "no proper rotation in row 0"),
        (np.diag([2.0, 0.5, 1, 1]), "no proper rotation in row 0"),
        (np.diag([1.0, 1, 1, 2]), "last line isn't 0 0 0 1 in row 0"),
        (np.full((4, 4), np.nan), "NaN or infinite in row 0"),
    ],
)
def test_camera_that_is_no_rigid_transform(data_set, edit, damage, said):
    world_from_cam = arrays_of(data_set)["world_from_cam"]
    world_from_cam[0] = damage
    refused(with_arrays(data_set, edit, world_from_cam=world_from_cam), "clip walk", said)


def test_what_a_desktop_leaves_is_no_part_of_a_folder(data_set):
    listing = data_set / "listings" / "masks.tsv"
    before = listing.read_bytes()
    for name in ("frames/.DS_Store", "masks/.DS_Store", "masks/.git/x"):
        (data_set / name).parent.mkdir(exist_ok=True)
        (data_set / name).write_bytes(b"Bud1")
    check_manifest(data_set / "set.yaml")
    walk = read_manifest(data_set / "set.yaml").clips[WALK]
    assert folder_record(data_set, data_set / "masks") == walk.masks
    assert listing.read_bytes() == before


def test_row_without_its_mask(data_set):
    """A kept row needs its mask, a dropped one doesn't."""
    for number in (2, 4):
        (data_set / "masks" / f"{number:05d}.png").unlink()
    folders = {"images": data_set / "frames", "masks": data_set / "masks"}
    entry = clip_entry(data_set, ClipFiles(data_set / "clips" / "walk.npz", **folders), a_walk())
    path = write_manifest(data_set / "again.yaml", a_head("again"), [entry])
    refused(path, "clip walk: masks.folder: none of number 4, which a row names")


def test_mask_of_no_image(data_set, edit):
    def change(data: dict) -> None:
        data["clips"][WALK]["masks"] = data["clips"][WALK]["images"]
        data["clips"][WALK]["images"] = masks

    masks = yaml.safe_load((data_set / "set.yaml").read_text())["clips"][WALK]["masks"]
    check_manifest(edit(change))  # the stems are the same either way
    (data_set / "masks" / "00003.png").rename(data_set / "masks" / "mask_3.png")
    masks = folder_record(data_set, data_set / "masks").model_dump()
    refused(edit(lambda data: data["clips"][WALK].update(images=masks)), "masks.folder: 00003.jpg")


def test_file_of_another_clip(data_set, edit, walk_clip):
    other = replace(walk_clip, id="run", motion=replace(walk_clip.motion, fps_hz=12.0))
    save_clip(data_set / "clips" / "walk.npz", other, np.zeros(3))
    message = refused(rehash(data_set, edit), "id: is walk, but the file has run")
    assert "fps_hz: is 10.0, but the file has 12.0" in message
    with pytest.raises(BadManifest, match="clip walk: id: is walk, but the file has run"):
        load_clips(data_set / "set.yaml")


def test_without_files_only_the_manifest_is_looked_at(data_set, edit):
    (data_set / "clips" / "bare.npz").unlink()
    check_manifest(data_set / "set.yaml", files=False)
    path = edit(lambda data: data["clips"][WALK].update(recipe=EDITED))
    with pytest.raises(BadManifest, match="clip walk: recipe.sha256"):
        check_manifest(path, files=False)


def test_all_problems_come_at_once(data_set):
    for number in range(6):
        (data_set / "frames" / f"{number:05d}.jpg").unlink()
    (data_set / "clips" / "bare.npz").unlink()
    message = refused(data_set / "set.yaml", "7 problems", "clips/bare.npz is missing")
    assert message.count("is missing") == 7


def test_rows_that_the_manifest_drops_are_not_valid(data_set, edit):
    def change(data: dict) -> None:
        data["clips"][WALK]["kept"] = [{"start": 0, "stop": 2}]
        data["clips"][WALK]["dropped"] = [{"start": 2, "stop": 6, "reason": "drift"}]

    path = edit(change)
    check_manifest(path)
    walk = load_clips(path)[WALK]
    assert walk.valid.tolist() == [True, True, False, False, False, False]
    assert read_manifest(path).clips[0].id == "bare"


def test_random_damage_to_the_arrays_never_escapes(data_set, edit):
    """Whatever bytes stand in the clip's file: it passes or it is refused, with no other error."""
    clip = data_set / "clips" / "walk.npz"
    content, rng = clip.read_bytes(), np.random.default_rng(11)
    refusals = 0
    for _ in range(60):
        damaged = bytearray(content)
        for at in rng.integers(len(content), size=3):
            damaged[at] = rng.integers(256)
        clip.write_bytes(damaged)
        try:
            check_manifest(rehash(data_set, edit))
        except BadManifest:
            refusals += 1
    assert refusals > 20


def test_rotations_from_other_code_pass_within_rounding(data_set, edit):
    """Cameras that went through float32 quaternions are still rotations after normalisation."""
    quaternions = np.float32(Rotation.random(6, random_state=1).as_quat()).astype(float)
    world_from_cam = np.tile(np.eye(4), (6, 1, 1))
    world_from_cam[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    check_manifest(with_arrays(data_set, edit, world_from_cam=world_from_cam))
