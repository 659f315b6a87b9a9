"""What stages left is found again as clips, whatever is named: a manifest, a file or a folder."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from gmrdata.export.sources import ExportedClip, list_clips, load_exported
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, save_clip
from gmrdata.values.errors import (
    BadBodyFile,
    BadFrames,
    BadManifest,
    BadMotionFile,
    MissingInput,
)
from tests.clip_manifests import write_clips


@pytest.fixture
def clip(walkers) -> Clip:
    return replace(walkers[0], id="walk")


def save(path: Path, clip: Clip, body: BodyModel) -> Path:
    save_clip(path, clip, body.rest_pelvis_m(clip.motion.shape))
    return path


def only(source: Path) -> ExportedClip:
    (files,) = list_clips(source)
    return load_exported(files)


def test_a_clip_file_and_its_body_beside_it(clip, small_body, tmp_path):
    path = save(tmp_path / "in/some.npz", replace(clip, id="../a b"), small_body)
    exported = only(path)
    assert exported.id == exported.sequence == "_a_b"  # fit for a file, and in no other folder
    assert exported.images_dir is exported.masks_dir is exported.sfm_dir is exported.truth is None
    with pytest.raises(MissingInput, match=r"needs the body .*\. Give it with --body"):
        _ = exported.body
    save_body(tmp_path / "in/body/body.npz", small_body)
    assert only(path).body.name == small_body.name
    larger = replace(small_body, joints_template_m=1.1 * small_body.joints_template_m)
    save_body(tmp_path / "body/body.npz", larger)  # of the same name, and farther away
    found_m = only(path).body.joints_template_m
    np.testing.assert_allclose(found_m, small_body.joints_template_m, atol=1e-6)
    save_body(tmp_path / "larger.npz", larger)
    (files,) = list_clips(path)
    with pytest.raises(BadBodyFile, match="made with another body"):
        _ = load_exported(files, body=str(tmp_path / "larger.npz")).body


def test_a_rendered_clip_has_its_images_masks_and_company(clip, walkers, small_body, tmp_path):
    save(tmp_path / "clip.npz", clip, small_body)
    save(tmp_path / "extras/company_1.npz", walkers[1], small_body)
    np.savez(tmp_path / "extras/car_1.npz", world_from_car=np.eye(4))
    for name in ("frames", "masks"):
        (tmp_path / name).mkdir()
    (tmp_path / "frames/00003.png").touch()
    for source in (tmp_path, tmp_path / "clip.npz"):
        exported = only(source)
        assert exported.images_dir == tmp_path / "frames"
        assert exported.masks_dir == tmp_path / "masks"
        assert [extra.id for extra in exported.extras] == ["walk.p1"]
        paths = exported.image_paths()
        assert paths[3] == tmp_path / "frames/00003.png" and set(paths) == {None, paths[3]}
    (tmp_path / "masks/00003.png").touch()
    assert only(tmp_path).mask_paths()[3] == tmp_path / "masks/00003.png"
    (tmp_path / "masks/00004.png").touch()  # numbered from 1, each lay on the image before
    with pytest.raises(BadFrames, match="no image in .*frames for the masks of number 4. Number"):
        only(tmp_path).mask_paths()
    (tmp_path / "frames/00003_depth.png").touch()  # either was taken, as the disk lists them
    with pytest.raises(BadFrames, match=r"number 3, 00003\.png and 00003_depth\.png. Keep other"):
        exported.image_paths()


def test_people_of_one_sequence_share_it(walkers, small_body, tmp_path):
    for number, walker in enumerate(walkers):
        save(tmp_path / f"walk/pseudo_gt/person_{number}.npz", walker, small_body)
    (tmp_path / "walk/sfm").mkdir()
    (tmp_path / "walk/sfm/cameras.npz").touch()
    for source in (tmp_path / "walk", tmp_path / "walk/pseudo_gt"):
        people = list_clips(source)
        assert [person.id for person in people] == ["walk.p0", "walk.p1"]
        assert {person.sequence for person in people} == {"walk"}
        assert {person.sfm_dir for person in people} == {tmp_path / "walk/sfm"}
    (one,) = list_clips(tmp_path / "walk/pseudo_gt/person_1.npz")
    assert (one.id, one.sfm_dir) == ("walk.p1", tmp_path / "walk/sfm")


def test_people_of_a_video_are_those_with_the_network_s_motions_where_these_are_there(
    walkers, small_body, tmp_path
):
    for stage, walker in zip(("pseudo_gt", "fused"), walkers, strict=True):
        save(tmp_path / f"walk/{stage}/person_0.npz", replace(walker, id="walk"), small_body)
    (tmp_path / "walk/sfm").mkdir()
    (tmp_path / "walk/sfm/cameras.npz").touch()
    fused = tmp_path / "walk/fused"
    for source in (tmp_path / "walk", fused, fused / "person_0.npz"):
        (one,) = list_clips(source)
        assert one.clip_path == fused / "person_0.npz" and one.sfm_dir == tmp_path / "walk/sfm"
    (one,) = list_clips(tmp_path / "walk/pseudo_gt")
    assert one.clip_path == tmp_path / "walk/pseudo_gt/person_0.npz"


def test_people_come_by_their_numbers(walkers, small_body, tmp_path):
    for number in range(11):
        clip = replace(walkers[0], id=f"p{number}")
        save(tmp_path / f"walk/pseudo_gt/person_{number}.npz", clip, small_body)
    assert [one.id for one in list_clips(tmp_path / "walk")] == [f"p{n}" for n in range(11)]


def test_a_manifest_says_which_frames_are_kept(clip, small_body, tmp_path):
    manifest = write_clips(tmp_path, small_body, [clip], camera_motions=["circular"])
    data = yaml.safe_load(manifest.read_text())
    data["clips"][0] |= {
        "kept": [{"start": 0, "stop": 4}],
        "dropped": [{"start": 4, "stop": 30, "reason": "a test"}],
    }
    manifest.write_text(yaml.safe_dump(data))
    assert only(manifest).clip.valid.sum() == only(tmp_path).clip.valid.sum() == 4


def test_of_a_demo_the_result_is_taken_and_the_rendered_clip_is_its_truth(
    clip, small_body, tmp_path
):
    moved = replace(clip, motion=replace(clip.motion, pelvis_m=clip.motion.pelvis_m + 1))
    for name, one in (("synthetic", clip), ("pseudo_gt", moved)):
        folder = tmp_path / "stages" / name
        write_clips(folder, small_body, [one], camera_motions=["circular"])
        text = (folder / "manifest.yaml").read_text()
        (folder / "manifest.yaml").unlink()
        (tmp_path / f"{name}.yaml").write_text(text.replace("walk.npz", f"stages/{name}/walk.npz"))
    exported = only(tmp_path)
    np.testing.assert_allclose(exported.clip.motion.pelvis_m, moved.motion.pelvis_m)
    assert exported.truth is not None
    np.testing.assert_allclose(exported.truth.motion.pelvis_m, clip.motion.pelvis_m)


def test_a_truth_is_read_as_a_clip_is(clip, small_body, tmp_path):
    """Rows that its manifest drops were used all the same, and NaN ended in a traceback."""
    truth = write_clips(tmp_path, small_body, [clip])
    data = yaml.safe_load(truth.read_text())
    rows = {"kept": [{"start": 0, "stop": 4}], "dropped": [{"start": 4, "stop": 30, "reason": "a"}]}
    data["clips"][0] |= rows
    truth.write_text(yaml.safe_dump(data))
    (files,) = list_clips(tmp_path / "walk.npz")
    files = replace(files, truth_files=list_clips(truth)[0])
    found = load_exported(files)
    assert found.truth is not None and found.truth.valid.sum() == 4 < found.clip.valid.sum()
    pelvis_m = clip.motion.pelvis_m.copy()
    pelvis_m[3] = np.nan
    broken = replace(clip, motion=replace(clip.motion, pelvis_m=pelvis_m))
    (truth_files,) = list_clips(save(tmp_path / "broken.npz", broken, small_body))
    with pytest.raises(BadMotionFile, match=r"broken\.npz: arrays\.trans: NaN .* in kept row 3"):
        load_exported(replace(files, truth_files=truth_files))


def test_the_motions_of_inference_are_clips(clip, small_body, tmp_path):
    for name in ("person_2", "person_1"):
        save(tmp_path / name / "clip.npz", replace(clip, id=name), small_body)
    (tmp_path / "infer.json").touch()
    assert [files.id for files in list_clips(tmp_path)] == ["person_1", "person_2"]
    assert [files.id for files in list_clips(tmp_path, ["person_2"])] == ["person_2"]


def test_predictions_and_other_folders_of_clips(walkers, small_body, tmp_path):
    for walker in walkers:
        save(tmp_path / "predictions" / f"{walker.id}.npz", walker, small_body)
    np.savez(tmp_path / "predictions/other.npz", numbers=np.arange(3))
    for source in (tmp_path, tmp_path / "predictions"):
        assert [files.id for files in list_clips(source)] == ["walk.p0", "walk.p1"]


def test_a_clip_that_cannot_be_read_has_its_files_or_its_folders_name(clip, small_body, tmp_path):
    """It kept the others from being listed; loading it says what is wrong."""
    infer, people = tmp_path / "infer", tmp_path / "walk"
    for path in (infer / "person_1" / "clip.npz", people / "pseudo_gt" / "person_0.npz"):
        save(path, clip, small_body)
        broken = str(path).replace("person_1", "person_2").replace("person_0", "person_1")
        Path(broken).parent.mkdir(exist_ok=True)
        Path(broken).write_bytes(path.read_bytes()[:500])
    (infer / "infer.json").touch()
    assert [files.id for files in list_clips(infer)] == ["walk", "person_2"]
    assert [files.id for files in list_clips(people)] == ["walk", "person_1"]
    with pytest.raises(BadMotionFile, match=r"person_1\.npz: not a readable"):
        load_exported(list_clips(people, ["person_1"])[0])


def test_another_files_objects_do_not_keep_a_folder_of_clips(clip, small_body, tmp_path):
    save_clip(tmp_path / "walk.npz", clip, small_body.rest_pelvis_m(clip.motion.shape))
    np.savez(tmp_path / "of_others.npz", poses=np.zeros(3), about=np.array({}, dtype=object))
    assert [files.clip_path.name for files in list_clips(tmp_path)] == ["walk.npz"]


def test_twins_and_a_noise_floor_lead_to_their_manifests(clip, small_body, tmp_path):
    write_clips(tmp_path / "render_set", small_body, [clip], camera_motions=["circular"])
    assert only(tmp_path).truth is None
    floor = tmp_path / "floor"
    shutil.copytree(tmp_path / "render_set", floor / "regenerated")
    save(floor / "twins/truth/walk.npz", clip, small_body)
    assert only(floor).truth is not None


def test_what_holds_no_clips_says_what_to_name(clip, small_body, tmp_path):
    with pytest.raises(MissingInput, match="no such file or folder"):
        list_clips(tmp_path / "nothing")
    for name in ("folder.npz", "folder.yaml"):
        (tmp_path / name).mkdir()
    with pytest.raises(MissingInput, match=r"Name a manifest \(\.yaml\) or a clip's file"):
        list_clips(tmp_path)
    (tmp_path / "alone" / "sfm").mkdir(parents=True)
    (tmp_path / "alone" / "sfm" / "cameras.npz").touch()
    with pytest.raises(MissingInput, match=r"cameras alone, .* people. .gmrdata video. leaves"):
        list_clips(tmp_path / "alone")
    manifest = write_clips(tmp_path, small_body, [clip], camera_motions=["circular"])
    with pytest.raises(MissingInput, match=r"no clip run; there are walk"):
        list_clips(manifest, ["run"])
    shutil.copy(manifest, tmp_path / "second.yaml")
    with pytest.raises(MissingInput, match=r"Name one of manifest\.yaml, second\.yaml"):
        list_clips(tmp_path)


def test_a_link_that_leads_nowhere_is_not_left_out_in_silence(clip, small_body, tmp_path):
    save(tmp_path / "walk.npz", clip, small_body)
    (tmp_path / "gone.npz").symlink_to("nothing")
    with pytest.raises(MissingInput, match=r"gone\.npz: no such file"):
        list_clips(tmp_path)


def test_a_path_out_of_the_manifests_folder_is_not_followed(clip, small_body, tmp_path):
    manifest = write_clips(tmp_path / "in", small_body, [clip], camera_motions=["circular"])
    (tmp_path / "in/walk.npz").rename(tmp_path / "walk.npz")
    (tmp_path / "in/walk.npz").symlink_to(tmp_path / "walk.npz")
    with pytest.raises(BadManifest, match="link out of the manifest's folder"):
        list_clips(manifest)
