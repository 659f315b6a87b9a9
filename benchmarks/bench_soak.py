"""Kill, fill and unplug, again and again, and compare the bytes with those of undisturbed runs.

`make soak` takes an hour, `ARGS='--hours 8'` longer.  In turn it runs motions in shares, motions,
render, threedpw, sfm and video, train, and evaluate at small sizes.  Each run is hit by up to
six faults at random moments: its processes are killed, its disk is full, and as root a host of
its cluster is unplugged.  It is started again until it ends well.  Then all of its files must be
those of the undisturbed run.  Writes out/bench/soak.json; the seed is new each time and in it.
"""

import os
import secrets
import shutil
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from film.set_kills import write_recipe
from record import OUT_DIR, Record, at_least, at_most
from scale import sharing
from soak.faults import Hit, end_well, hit, in_turn
from soak.works import Work, contents_of

from gmrdata.manifest.read import read_manifest
from gmrdata.stage.progress import answers
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import camera_of
from gmrdata.write.video import write_video_of
from tests.world.test_compose import as_input, person_files

pytestmark = pytest.mark.bench
OUT = OUT_DIR / "soak.json"
FAULTS_AN_HOUR = 200
GMR = {
    "model": {"layers": 1, "hidden": 16}, "loss": {"n_vertices": 20}, "steps": 120, "seed": 3,
    "checkpoint_every": 10, "batch_size": 8, "windows": {"frames": 16},
}  # fmt: skip


@pytest.fixture(scope="module")
def works(
    tmp_path_factory: pytest.TempPathFactory,
    cmu_dir: Path,
    filmed_set: Any,
    small_body: BodyModel,
) -> list[Work]:
    """The verbs, each with its input made."""
    root = tmp_path_factory.mktemp("input")
    motions = sharing.motion_files(cmu_dir / "bvh", root / "motions", 12)
    write_recipe(root / "set.yaml", n_clips=2, n_frames=5)
    recipe = filmed_set.recipe(recipe="threedpw", workers=2)
    (root / "threedpw.yaml").write_text(yaml.safe_dump(recipe.model_dump(mode="json")))
    (root / "gmr.yaml").write_text(yaml.safe_dump({"recipe": "gmr", "train": GMR}))
    library = Work("motions", ("motions", str(motions)), root / "library")
    assert end_well(library.start()) == 0
    manifest = root / "library" / "motions.yaml"
    assert len(read_manifest(manifest).clips) == 12
    trained = Work(
        "train", ("train", str(manifest), "--recipe", str(root / "gmr.yaml")), root / "run"
    )
    assert end_well(trained.start()) == 0
    data = filmed_set.root
    seen = seen_in_video(filmed_set, small_body, root)
    focal_px = str(camera_of(filmed_set.truth["pan_00"][0]).intrinsics_px[0, 0])
    return [
        Work("shards", ("motions", str(motions), "--workers", "1"), shards=2),
        Work("motions", ("motions", str(motions)), on_hosts=True),
        Work("render", ("render", str(root / "set.yaml")), on_hosts=True),
        Work("threedpw", ("threedpw", "regenerate", "--threedpw", str(data),
                          "--recipe", str(root / "threedpw.yaml")), on_hosts=True),
        Work("sfm", ("sfm", *seen)),
        Work("video", ("video", str(root / "pan.mp4"), "--masks", "none", "--focal", focal_px,
                       "--poses", "none")),
        Work("train", trained.command),
        Work("evaluate", ("evaluate", str(root / "run"), str(manifest))),
    ]  # fmt: skip


def seen_in_video(filmed_set: Any, body: BodyModel, root: Path) -> list[str]:
    """Arguments of `gmrdata sfm` for a video of a sequence, and its person as the camera saw it."""
    images = sorted((filmed_set.root / "imageFiles" / "pan_00").iterdir())
    write_video_of(images, root / "pan.mp4", 30.0)
    seen = person_files(root, as_input(filmed_set.truth["pan_00"][0]), body)
    people = ("--camera-body", seen.clip_path, "--body", seen.body_path)
    return [str(word) for word in (root / "pan.mp4", *people)]


def test_soak(request: pytest.FixtureRequest, works: list[Work], tmp_path: Path) -> None:
    small = request.config.getoption("--small")
    hours = 0.01 if small else float(request.config.getoption("--hours"))
    seed = int(os.environ.get("GMRDATA_SEED", secrets.randbits(32)))
    rng = np.random.default_rng(seed)
    record = Record(OUT, small, lambda: {"hours": hours, "seed": seed, "cores": os.cpu_count()})
    expected = {}
    for work in works:
        whole = work.into(tmp_path / f"undisturbed_{work.name}" / "out")
        started_s = time.monotonic()
        assert end_well(whole.start()) == 0, whole.said()
        expected[work.name] = contents_of(whole.out), time.monotonic() - started_s
    hits: list[Hit] = []
    survived, lost, different, loops, begin_s = 0, 0, 0, 0, time.monotonic()
    while time.monotonic() - begin_s < 3600 * hours:
        for work, faults in in_turn(works, rng):
            if time.monotonic() - begin_s > 3600 * hours:
                break
            wanted, whole_s = expected[work.name]
            mine = work.into(tmp_path / "now" / "out")  # the name of a folder is in manifests
            mine_hits = hit(mine, faults, whole_s, rng)
            hits += mine_hits
            ended = any(end_well(mine.start()) == 0 for _ in range(3))
            found = contents_of(mine.out)
            lost += not ended or bool(wanted.keys() - found.keys())
            different += found != wanted
            survived += len(mine_hits) * (ended and found == wanted)
            if not ended or found != wanted:
                keep(mine, tmp_path / f"different_{len(hits)}", wanted, mine_hits)
            mine.clear()
            record.add(
                faults=len(hits), survived=survived, lost=lost, different=different, loops=loops,
                minutes=round((time.monotonic() - begin_s) / 60, 1),
                hits=[met._asdict() for met in hits],
            )  # fmt: skip
        loops += 1
    answers.print(
        f"{len(hits)} faults in {(time.monotonic() - begin_s) / 3600:.2f} h: "
        f"{survived} survived, {lost} runs lost, {different} with different bytes"
    )
    record.hold(
        [
            at_least("faults", len(hits), FAULTS_AN_HOUR * hours),
            at_most("lost", lost, 0),
            at_most("different", different, 0),
        ]
    )


def keep(work: Work, folder: Path, wanted: Mapping[str, str], hits: Sequence[Hit]) -> None:
    """Keep a run that ended otherwise, with all that it said, and say what differs."""
    found = contents_of(work.out)
    names = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    answers.print(f"{work.name}: {len(names)} files differ after {hits}: {names[:10]}; {folder}")
    shutil.copytree(work.out, folder)
    shutil.copy(work.log, folder.with_suffix(".log"))
