"""People's outlines on rendered people, whose masks are known, and where nobody is seen."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.film.programmes import Film, Small, film_motion, plan_clip
from gmrdata.film.render import RenderConfig, render_clip
from gmrdata.film.scene import SceneConfig
from gmrdata.motion.gait import make_gait
from gmrdata.people.following import Networks
from gmrdata.people.linking import fill_boxes
from gmrdata.people.onnx import OnnxConfig, open_detector
from gmrdata.people.sources import MasksConfig, PersonSource, make_masks
from gmrdata.read.bodies import ANNY_FILE
from gmrdata.read.frames import read_color, read_frames, read_gray
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import save_clip

N_FRAMES = 5


@pytest.fixture(scope="module")
def rendered(anny: BodyModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`frames` and exact `masks` of a dressed person of 150 px who walks through a room."""
    folder = tmp_path_factory.mktemp("rendered")
    rng = np.random.default_rng(3)
    film = Film(fps_hz=10, duration_s=N_FRAMES / 10, width_px=320, height_px=240)
    motion = film_motion(make_gait("walk", N_FRAMES / 10, 30.0, anny, rng), film)
    clip = plan_clip("walk", motion, Small(), film, rng)
    save_clip(folder / "clip.npz", clip, anny.rest_pelvis_m(motion.shape))
    room = RenderConfig(samples=1, scene=SceneConfig(kind="room", seed=3), image_format="png")
    files = folder / "clip.npz", ANNY_FILE, folder / "render"
    return render_clip(*files, room, on_frame=lambda frame: None)


@pytest.fixture
def masked(networks: Networks, tmp_path: Path) -> Callable[..., np.ndarray]:
    """The masks (T, H, W) bool of a folder of frames, not widened."""

    def run(frames: Path, **settings: float) -> np.ndarray:
        files = {"model": networks.detector, "landmarks": networks.landmarks}
        source = PersonSource(dilate_px=0, **files, **settings)
        return read_masks(
            make_masks(read_frames(frames), tmp_path / "masks", MasksConfig(sources=(source,)))
        )

    return run


def read_masks(folder: Path) -> np.ndarray:
    return np.stack([read_gray(path) == 255 for path in sorted(folder.glob("*.png"))])


def iou_and_recall(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    common = (found & true).sum(axis=(1, 2))
    return common / (found | true).sum(axis=(1, 2)), common / true.sum(axis=(1, 2))


@pytest.mark.slow
def test_outlines_are_those_of_the_rendered_person(
    rendered: Path, masked: Callable[..., np.ndarray]
) -> None:
    iou, recall = iou_and_recall(masked(rendered / "frames"), read_masks(rendered / "masks"))
    assert len(iou) == N_FRAMES
    assert iou.mean() >= 0.85 and iou.min() >= 0.8
    assert recall.mean() >= 0.95 and recall.min() >= 0.9


@pytest.mark.slow
def test_whom_the_detector_sees_in_one_frame_is_followed_to_the_first_and_the_last(
    rendered: Path, yolox_nano: Path, masked: Callable[..., np.ndarray], tmp_path: Path
) -> None:
    """A second person, the first one's mirror image, stands on the right from frame 1 on."""
    (tmp_path / "frames").mkdir()
    detect = open_detector(yolox_nano, OnnxConfig(classes=("person",)))
    newcomers, scores = [], []
    for row, path in enumerate(sorted((rendered / "frames").glob("*.png"))):
        image = read_color(path)
        mirrored, mask = (np.fliplr(p) for p in (image, read_gray(rendered / "masks" / path.name)))
        moved = np.float32([[1, 0, 320 - mask.any(axis=0).argmax() - 66 - 8 * row], [0, 1, 0]])
        mirrored, mask = (cv2.warpAffine(p.copy(), moved, (320, 240)) for p in (mirrored, mask))
        newcomers.append((mask == 255) & (row > 0))
        image[newcomers[-1]] = mirrored[newcomers[-1]]
        cv2.imwrite(str(tmp_path / "frames" / path.name), image)
        found = detect(image)
        scores += found.scores[found.boxes_px[:, 0] > 200].tolist()
    assert sorted(scores)[-2] < max(scores)
    found = masked(tmp_path / "frames", min_detector_score=max(scores))
    assert not found[0, :, 200:].any()
    iou, recall = iou_and_recall(found[1:, :, 200:], np.array(newcomers)[1:, :, 200:])
    assert iou.mean() >= 0.8 and recall.mean() >= 0.85 and recall.min() >= 0.75


def test_nobody_gives_empty_masks_and_is_said(
    masked: Callable[..., np.ndarray], noise_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = masked(noise_dir)
    assert found.shape == (3, 48, 64) and not found.any()
    said = " ".join(capsys.readouterr().err.split())
    assert "nothing is masked in frame 00000, 00001, 00002 (3 of 3)" in said


def test_whom_the_landmark_network_does_not_see_gets_the_box(
    yolox_nano: Path,
    shared_path: Callable[[str], Path],
    masked: Callable[..., np.ndarray],
    tmp_path: Path,
) -> None:
    """No score reaches 1, so that nobody counts as seen."""
    (tmp_path / "frames").mkdir()
    detect = open_detector(yolox_nano, OnnxConfig(classes=("person",), weak_score=0.35))
    boxes = []
    for row, name in enumerate(("00001.jpg", "00003.jpg")):
        image = read_color(shared_path("video/static_people") / name)
        cv2.imwrite(str(tmp_path / "frames" / f"{row}.png"), image)
        boxes.append(fill_boxes(detect(image).boxes_px, image.shape[1::-1]) == 255)
    found = masked(tmp_path / "frames", min_score=1.0)
    np.testing.assert_array_equal(found, boxes)
    assert found.any(axis=(1, 2)).all()
