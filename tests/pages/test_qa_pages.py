"""The pages of a regenerated set say what was decided, point to files, and survive broken ones."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cameras.files import load_cameras, save_cameras
from gmrdata.pages.batches import write_set_pages
from gmrdata.pages.gather import gather_sequence
from gmrdata.pages.solved import SolvedSequence
from gmrdata.stage.run import Run
from gmrdata.threedpw.recipe import SetPaths
from gmrdata.threedpw.regenerate import Verdicts, choose, regenerate_set
from gmrdata.values.files import read_json, write_json
from gmrdata.world.recipe import save_dataset_camera
from tests.pages.html_pages import Page

pytestmark = pytest.mark.slow


def draw(made: Any, out_dir: Path) -> None:
    """Write the pages once more."""
    write_set_pages(made.recipe(), made.root, out_dir)


@pytest.fixture
def copied_out(made_set, tmp_path) -> Path:
    shutil.copytree(made_set, tmp_path / "out")
    return tmp_path / "out"


def test_the_index_leads_to_every_page_and_they_to_the_records(made_set):
    index = Page(made_set / "index.html")
    names = ["arc_00", "pan_00"]
    pages = [made_set / "qa" / f"{name}.html" for name in names]
    assert index.files == [made_set / "pseudo_gt.yaml", made_set / "verdicts.json", *pages]
    assert index.tags.count("img") == 2
    assert "Accepted2Rejected0" in index.words
    for name, path in zip(names, pages, strict=True):
        page = Page(path)
        assert all(file.is_file() for file in page.files)
        stages = {file.parent.name for file in page.files if file.name == "stage.json"}
        assert stages == {"people", "masks", "sfm", "lines", "pseudo_gt"}
        assert page.files[0] == made_set / "index.html"
        assert page.tags.count("img") == 6 and page.tags.count("svg") == (4 if "arc" in name else 3)
        assert "can’t be" not in page.words
        assert "In 3D" in page.words and path.with_name("view3d") / path.name in page.files


def test_a_page_says_the_figures_of_the_record(made_set):
    words = Page(made_set / "qa" / "arc_00.html").words
    record = read_json(made_set / "sequences" / "arc_00" / "pseudo_gt" / "quality.json")
    assert "Person 0: accepted, 36 of 36 frames (100.0%)" in words and "Person 1" in words
    cameras = record["cameras"]
    assert f"mean reprojection error [px]{cameras['mean_reprojection_px']:.3g} ✓≤ 1" in words
    assert f"fewest inliers{min(cameras['inliers_per_frame'])} ✓≥ 25" in words
    assert f"fused{record['scale']:.5g}" in words
    for cue in record["scale_cues"]:
        assert f"{cue['scale']:.5g}" in words
    assert "Camera: circular" in words and f"Points{cameras['points']}" in words
    assert "over the 36 kept frames" in words and "No frame is dropped." in words
    pan = Page(made_set / "qa" / "pan_00.html").words
    assert "Scale does not enter" in pan and "rotation only (the camera pans)" in pan


def test_the_picture_shows_the_mask(made_set, filmed_set):
    from gmrdata.pages.batches import TILE_WIDTH_PX, read_tile

    files = choose(filmed_set.root, ["arc_00"])[0][0]
    masks_dir = made_set / "sequences" / "arc_00" / "masks"
    tile = read_tile(files, masks_dir, 5)
    bare = read_tile(files, masks_dir.with_name("nowhere"), 5)
    assert tile.problem == "" and bare.problem == "no masks were made"
    assert tile.picture is not None and bare.picture is not None
    changed = (tile.picture != bare.picture).any(axis=2)
    mask = cv2.imread(str(masks_dir / "image_00005.png"), cv2.IMREAD_GRAYSCALE)
    size_px = (TILE_WIDTH_PX, tile.picture.shape[0])
    masked = cv2.resize(mask, size_px, interpolation=cv2.INTER_NEAREST) > 0
    assert masked.sum() > 200
    assert changed[masked].all()
    # The outline is as wide as two pixels.
    around = cv2.dilate(masked.astype(np.uint8), np.ones((7, 7))) > 0
    assert not changed[~around].any()


def test_a_rejected_sequence_is_listed_apart_with_the_figure_that_failed(copied_out, filmed_set):
    verdict = {"max_reprojection_px": 0.001}
    recipe = filmed_set.recipe()
    sequence = recipe.sequence.model_dump() | {"pseudo_gt": {"verdict": verdict}}
    stricter = filmed_set.recipe(sequence=sequence)
    regenerate_set(stricter, filmed_set.root, copied_out, run=Run(redo=True))
    write_set_pages(stricter, filmed_set.root, copied_out)
    index = Page(copied_out / "index.html").words
    assert "Accepted0Rejected2" in index and "more than 0.001 px" in index
    words = Page(copied_out / "qa" / "arc_00.html").words
    assert "Person 0: rejected, 36 of 36 frames" in words
    error_px = read_json(copied_out / "sequences/arc_00/sfm/quality.json")["mean_reprojection_px"]
    assert f"mean reprojection error [px]{error_px:.3g} ✗≤ 0.001" in words
    assert "within the thresholds, but rejected" in words


def test_what_was_lost_since_costs_a_picture_and_is_named(copied_out, filmed_set, copied_set):
    arc = copied_out / "sequences" / "arc_00"
    (arc / "sfm" / "cameras.npz").unlink()
    (arc / "people" / "dataset_camera.npz").write_bytes(b"PK\x03\x04 cut off")
    (arc / "pseudo_gt" / "person_0.npz").unlink()
    (arc / "masks" / "image_00014.png").unlink()
    (copied_set.root / "imageFiles" / "arc_00" / "image_00007.jpg").unlink()
    outside = copied_set.root.parent / "secret.jpg"
    shutil.copy(copied_set.root / "imageFiles" / "arc_00" / "image_00021.jpg", outside)
    linked = copied_set.root / "imageFiles" / "arc_00" / "image_00021.jpg"
    linked.unlink()
    linked.symlink_to(outside)
    shutil.rmtree(copied_out / "sequences" / "pan_00" / "pseudo_gt")
    (copied_out / "sequences" / "pan_00" / "people" / "people.json").write_text("{")
    draw(copied_set, copied_out)
    page = Page(copied_out / "qa" / "arc_00.html")
    for lost in ("cameras.npz", "dataset_camera.npz", "person_0.npz"):
        assert lost in page.words.split("Can’t be read")[1]
    assert "no mask for image_00014.jpg" in page.words
    assert "image_00007.jpg: missing" in page.words
    assert "a link out of" in page.words
    assert page.tags.count("img") == 4
    # The other person's world motion is still drawn, and the inliers are said to be unknown.
    assert page.tags.count("svg") == 4 and "person 1" in page.words and "not known" in page.words
    assert "quality.json: no such file" in Page(copied_out / "qa" / "pan_00.html").words


def test_a_camera_of_the_data_set_that_is_none_costs_its_plots_alone(copied_out, filmed_set):
    ((files,), _), verdicts = choose(filmed_set.root, ["arc_00"]), copied_out / "verdicts.json"
    verdict = Verdicts.read(verdicts).sequences[0]
    path = copied_out / "sequences" / "arc_00" / "people" / "dataset_camera.npz"

    def gathered(n_frames: int) -> SolvedSequence:
        save_dataset_camera(path, np.zeros((n_frames, 4, 4)))
        return gather_sequence(verdict, "", files, filmed_set.recipe(), SetPaths(copied_out))

    nowhere = gathered(36).dataset_camera
    assert nowhere is not None and np.isnan(nowhere).all()
    cut = gathered(5)
    assert cut.dataset_camera is None and "is of 5 frames, not 36" in cut.missing[0]


def test_cuts_and_interpolated_frames_are_found_by_their_images(copied_out, filmed_set):
    files = choose(filmed_set.root, ["arc_00"])[0][0]
    verdict = Verdicts.read(copied_out / "verdicts.json").sequences[0]
    paths = SetPaths(copied_out)
    whole = gather_sequence(verdict, "", files, filmed_set.recipe(), paths)
    assert whole.sfm_rows is not None and whole.sfm_rows.tolist() == list(range(36))
    assert whole.kept.all() and whole.world_from_cam is not None and not whole.missing
    cameras = load_cameras(paths.sequence_dir("arc_00") / "sfm")
    left = np.flatnonzero(~np.isin(np.arange(36), [7, 20]))
    path = cameras.path.at_rows(left)
    between = cameras.interpolated[left]
    fewer = replace(cameras, path=path, image_numbers=left, interpolated=between)
    save_cameras(paths.sequence_dir("arc_00") / "sfm" / "cameras.npz", fewer)
    quality_path = paths.pseudo_gt_dir("arc_00") / "quality.json"
    record = read_json(quality_path)
    inliers = record["cameras"]["inliers_per_frame"][:34]
    record["cameras"] |= {"frames": 34, "inliers_per_frame": inliers}
    record["cameras"] |= {"cuts_after_frames": [6], "interpolated": [19, 33]}
    write_json(quality_path, record)
    found = gather_sequence(verdict, "", files, filmed_set.recipe(), paths)
    assert found.frames_of([6, 7, 18, 19, 33]).tolist() == [6, 8, 19, 21, 35]
    draw(filmed_set, copied_out)
    words = Page(copied_out / "qa" / "arc_00.html").words
    assert "Cuts1" in words and "Interpolated frames2" in words


def test_a_joined_model_is_listed_with_what_became_of_it(copied_out, filmed_set):
    quality_path = SetPaths(copied_out).pseudo_gt_dir("arc_00") / "quality.json"
    models = [
        {"frames": 30, "kept": True, "reason": "the largest"},
        {"frames": 6, "kept": False, "reason": "it shares <nothing>"},
    ]
    record = read_json(quality_path)
    record["cameras"]["models"] = models
    write_json(quality_path, record)
    draw(filmed_set, copied_out)
    page = Page(copied_out / "qa" / "arc_00.html")
    assert "Models2" in page.words and "30 frames, kept: the largest" in page.words
    assert "6 frames, dropped: it shares <nothing>" in page.words
