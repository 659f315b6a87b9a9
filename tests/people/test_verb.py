"""`gmrdata masks` as a person meets it."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.cli import main


def gmrdata(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_frames_are_masked_and_shown(yolox_nano: Path, dog_dir: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    answer = gmrdata("masks", dog_dir, "--out", out, "--detector", yolox_nano, "--classes", "dog")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.split() == [str(out / "masks"), str(out / "sheet" / "contact.jpg")]
    assert "detecting" in answer.stderr and "4/4" in answer.stderr
    record = json.loads((out / "masks" / "masks.json").read_text())
    assert record["sources"] == ["onnx"]
    assert all(0.01 < share["united"] < 0.5 for share in record["masked_share"].values())
    sheet = cv2.imread(str(out / "sheet" / "contact.jpg"))
    assert sheet is not None and sheet.shape[1] == 4 * 400 + 3 * 4


def fails(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    assert caught.value.code == 1
    return " ".join(capsys.readouterr().err.split())


def test_a_video_and_a_folder_of_masks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    (tmp_path / "made").mkdir()
    for i in range(3):
        video.write(np.full((48, 64, 3), 60 * i, np.uint8))
        cv2.imwrite(str(tmp_path / "made" / f"{i:05d}.png"), np.full((48, 64), 255, np.uint8))
    video.release()
    common = ("masks", tmp_path / "v.avi", "--out", tmp_path / "out", "--masks")
    main([str(argument) for argument in (*common, tmp_path / "made")])
    frames = sorted(p.name for p in (tmp_path / "out" / "frames").glob("*.jpg"))
    assert frames == [f"{i:05d}.jpg" for i in range(3)]
    said = " ".join(capsys.readouterr().err.split())
    assert "more than 90% of the picture is masked in frame 00000, 00001, 00002. Look" in said
    part = (*common, tmp_path / "made", "--redo", "--from", "0.05", "--to", "0.2")
    main([str(argument) for argument in part])
    frames = sorted(p.name for p in (tmp_path / "out" / "frames").glob("*.jpg"))
    assert frames == ["00001.jpg", "00002.jpg"]
    assert "to_s: 0.01 s is not after from_s, 0.05 s" in fails(capsys, *part[:-1], "0.01")
    of_folder = ("masks", tmp_path / "out" / "frames", *common[2:], tmp_path / "made")
    assert "are for a video file" in fails(capsys, *of_folder, "--every", "2")
    (tmp_path / "made" / "00001.png").unlink()
    assert "no mask for 00001.jpg" in fails(capsys, *common, tmp_path / "made", "--redo")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--masks", "person"), "no such model file; `gmrdata fetch models` gets it"),
        (("--masks", "silhouette"), "pass --camera-body"),
        (("--detector", "no.onnx"), "no.onnx: no such model file; `gmrdata fetch models` gets it"),
        (("--masks", "maskrcnn", "--detector", "m.onnx"), "--detector is for onnx and person"),
        (("--masks",), "nothing given. Name a source of masks"),
    ],
)
def test_what_is_missing_is_told(
    arguments: tuple[str, ...],
    said: str,
    noise_dir: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert said in fails(capsys, "masks", noise_dir, "--out", tmp_path / "out", *arguments)
    assert not (tmp_path / "out" / "masks").exists()
