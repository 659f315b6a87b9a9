"""The tutorial, word for word, on 36 small frames of a real video; then the notebook beside it."""

import json
import re
import shlex
import shutil
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.read import download, models
from gmrdata.score.records import Scores
from gmrdata.solve.verdict import VideoVerdict
from gmrdata.stage.progress import console
from tests.blender.jobs import in_blender
from tests.folders import REPOSITORY
from tests.read.videos import make_video

PAGE = REPOSITORY / "docs" / "tutorial.md"
NOTEBOOK = REPOSITORY / "examples" / "phone_video.ipynb"
BLOCK = re.compile(r"^```(sh|yaml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LITE = "pose_landmark_lite.tflite"
SEE_IN_BLENDER = """
import sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
kinds = sorted(thing.type for thing in bpy.data.objects)
open(sys.argv[2], "w").write(" ".join([*kinds, str(len(bpy.data.actions))]))
"""


@pytest.fixture(scope="module")
def folder(shared_path, tmp_path_factory) -> Iterator[Path]:
    """The tutorial's folder with walk.mp4, where every command has been run."""
    folder, cache = tmp_path_factory.mktemp("tutorial"), tmp_path_factory.mktemp("cache")
    phone_video(shared_path("video/dance.tar"), folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("XDG_CACHE_HOME", str(cache))
        fetched(patch, cache / "gmrdata" / "models", shared_path("models"))
        run_page()
        yield folder


def phone_video(frames: Path, folder: Path) -> None:
    """A dancer ten times a second, half as large as filmed."""
    pictures = []
    with tarfile.open(frames) as archive:
        for number in range(0, 108, 3):
            content = archive.extractfile(f"dance/rgbd/{number}.jpg")
            assert content is not None
            image = cv2.imdecode(np.frombuffer(content.read(), np.uint8), cv2.IMREAD_COLOR)
            pictures.append(cv2.resize(image, (360, 480), interpolation=cv2.INTER_AREA)[..., ::-1])
    small = [np.ascontiguousarray(picture) for picture in pictures]
    make_video(folder / "walk.mp4", small, rate_hz=10, options={"crf": "18"})


def fetched(patch: pytest.MonkeyPatch, there: Path, shared: Path) -> None:
    """The networks as `gmrdata fetch models` leaves them; the light one is called the heavy one."""
    there.mkdir(parents=True)
    shutil.copy(shared / models.YOLOX_NANO.name, there)
    for model in (models.POSE_LANDMARKS, models.QUICK_LANDMARKS):
        shutil.copy(shared / LITE, there / model.name)
    right = {there / model.name: model.sha256 for model in models.MODELS}
    plainly = models.sha256_of_file
    for module in (models, download):
        patch.setattr(module, "sha256_of_file", lambda path: right.get(path) or plainly(path))


def run_page() -> None:
    """Every command of the page, and its recipe with fewer steps."""
    for language, block in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if language == "yaml":
            Path("my_gmr.yaml").write_text(block.replace("steps: 100", "steps: 10"))
            continue
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words[0] == "gmrdata":
                main(words[1:])


@pytest.mark.slow
def test_the_video_is_accepted_and_has_a_page(folder):
    verdict = VideoVerdict.read(folder / "out/walk/verdict.json")
    assert verdict.accepted and [person.accepted for person in verdict.people] == [True]
    assert verdict.people[0].kept_frames == 36
    for page in ("index.html", "view3d.html"):
        assert (folder / "out/walk" / page).is_file()
    assert len((folder / "out/exported/tum/person_0.txt").read_text().splitlines()) >= 36


def test_blender_has_the_body_and_the_moving_camera(folder, tmp_path):
    script = tmp_path / "see.py"
    script.write_text(SEE_IN_BLENDER)
    in_blender(script, folder / "out/walk/files/glb/person_0.glb", tmp_path / "seen.txt")
    kinds = (tmp_path / "seen.txt").read_text().split()
    assert "ARMATURE" in kinds and "CAMERA" in kinds and int(kinds[-1]) >= 1


def test_both_networks_have_a_score_on_the_person(folder):
    for name in ("scores", "my_scores"):
        scores = Scores.read(folder / "out" / name / "scores.json")
        assert [clip.id for clip in scores.clips] == ["person_0.person_0_00000-00035"]
    assert (folder / "out/compared/comparison.html").is_file()


SOLVE = "video walk.mp4 --out out/walk --height-m 1.64"
CLIP = "out/walk/files/amass/person_0/person_0_00000-00035.npz"


def said_as_json(capsys: pytest.CaptureFixture[str], command: str) -> Any:
    capsys.readouterr()
    main([*shlex.split(command), "--json", "-q"])
    answer = capsys.readouterr()
    assert answer.err == ""
    return json.loads(answer.out)


def test_a_script_reads_answers_as_json(folder, capsys):
    solved = said_as_json(capsys, SOLVE)
    assert solved["verdict"]["accepted"] and solved["page"].endswith("out/walk/index.html")
    scored = said_as_json(capsys, "evaluate bundled out/person/motions.yaml --out out/scores")
    (scores,) = scored["scores"].values()
    assert scored["comparison"] is None
    assert scores == Scores.read(folder / "out/scores/scores.json").model_dump(mode="json")
    checked = said_as_json(capsys, "manifest check out/person/motions.yaml")
    assert checked["good"] and checked["manifests"][0]["problem"] is None
    with pytest.raises(SystemExit) as ended:
        main(["manifest", "check", "out/person/motions.yaml", "my_gmr.yaml", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert ended.value.code == 1 and [one["good"] for one in found["manifests"]] == [True, False]


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("motions out/walk/files/amass", ("person_0_00000-00035", "1 files, 1 to do")),
        ("train out/person/motions.yaml --recipe my_gmr.yaml", ("36", "10 steps", "to make")),
        ("infer " + CLIP, ("0-35", "to predict")),
        ("masks walk.mp4", ("masks", "walk.mp4: 36 images of 360x480 px")),
        ("sfm walk.mp4 --camera-body out/walk/bodies/person_0.npz", ("sfm", "36 images")),
        ("evaluate bundled out/person/motions.yaml", ("weights", "36")),
    ],
)
def test_a_dry_run_says_what_there_is_to_do_and_makes_nothing(folder, capsys, command, says):
    main([*shlex.split(command), "--out", "out/new", "--dry-run"])
    said = capsys.readouterr().out
    assert [word for word in says if word not in said] == []
    assert not list((folder / "out").glob("new*"))


def test_quiet_and_verbose(folder, capsys):
    capsys.readouterr()
    main(["-v", *shlex.split(SOLVE)])
    assert re.search(
        r"^\d\d:\d\d:\d\d sfm: there in .*out/walk/sfm$", capsys.readouterr().err, re.M
    )
    for loudness, traced in (("-q", False), ("-v", True)):
        with pytest.raises(SystemExit):
            main(["manifest", "check", "walk.mp4", loudness])
        error = capsys.readouterr().err
        assert "gmrdata: walk.mp4: not a manifest" in error
        assert ("Traceback" in error) == traced
    assert not console.quiet


def test_the_notebook_runs_over_the_public_api(folder, capsys):
    """In the tutorial's folder, so that the video need not be solved again."""
    solved = (folder / "out/walk/sfm/stage.json").stat().st_mtime_ns
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    names: dict[str, object] = {}
    for cell in cells:
        exec(compile(cell, str(NOTEBOOK), "exec"), names)
    said = capsys.readouterr().out
    assert "accepted\n" in said and "36 frames, a way of " in said
    assert "ome_deg" in said and "person_0.glb" in said
    assert (folder / "out/walk/sfm/stage.json").stat().st_mtime_ns == solved
    assert all(c["outputs"] == [] for c in notebook["cells"] if c["cell_type"] == "code")
