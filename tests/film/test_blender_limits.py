"""The limits of Blender's process, on a process that stands in for it."""

from pathlib import Path

import pytest

from gmrdata.film.render import RenderConfig, RenderJob, run_blender
from gmrdata.stage.jobs import Job, _attempt
from gmrdata.values.errors import BadRecipe, RenderOverLimit
from gmrdata.values.limits import MIB, blender_bytes, blender_frame_s
from tests.blender.jobs import facing_x
from tests.motions import save_bare


@pytest.fixture
def job(small_body, tmp_path) -> RenderJob:
    motion = facing_x(small_body, [[1.0, 1.0, 1.0]])
    clip_path = save_bare(tmp_path / "clip.npz", small_body, motion)
    paths = {"clip_path": clip_path, "body_path": tmp_path, "out_dir": tmp_path}
    return RenderJob(config=RenderConfig(), **paths)


def start(job: RenderJob) -> None:
    with (job.out_dir / "started").open("a") as file:
        file.write("x")
    run_blender(job, job.out_dir, print, module=str(Path(__file__).with_name("hungry_process.py")))


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ({"GMRDATA_BLENDER_GIB": "0.5"}, "more memory than the 512 MiB that it may have"),
        ({"GMRDATA_BLENDER_FRAME_S": "3"}, "more than 3 s for a frame"),
    ],
)
def test_a_limit_that_was_hit_is_said_and_not_tried_again(environment, said, job, monkeypatch):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(RenderOverLimit, match=said) as caught:
        _attempt(Job("one", start, {"job": job}, retries=1))
    assert f"{next(iter(environment))} in the environment" in str(caught.value)
    assert (job.out_dir / "started").read_text() == "x"


STARVED = """
import json, sys
from pathlib import Path

frames = Path(json.loads(Path(sys.argv[1]).read_text())["out_dir"]) / "frames"
for row in range(3):
    if not (frame := frames / f"{row:05d}.jpg").exists():
        frame.write_text("perhaps without a picture of its")
    print("gmrdata-frame", row, flush=True)
sys.exit("%s")
"""


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("Calloc returns null: len=6400000000 in imb_alloc_buffer, total 9194280", 1),
        ("terminate called after throwing an instance of 'std::bad_alloc'", 3),  # it ends at once
    ],
)
def test_frames_that_blender_made_without_memory_are_not_gone_on_from(job, tmp_path, said, kept):
    """The next run, with more memory, took them for good."""
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames/00000.jpg").write_text("of an earlier run")
    script = tmp_path / "starved.py"
    script.write_text(STARVED % said)
    with pytest.raises(RenderOverLimit, match="asked for more memory"):
        run_blender(job, tmp_path, print, module=str(script))
    frames = sorted((tmp_path / "frames").iterdir())
    assert [frame.name for frame in frames] == [f"{row:05d}.jpg" for row in range(kept)]
    assert frames[0].read_text() == "of an earlier run"


def test_limits_grow_with_the_recipe_and_are_the_environments_where_it_says_so(monkeypatch):
    assert 600 == blender_frame_s(0) < blender_frame_s(1920 * 1080 * 7) < 2100
    assert 256 * MIB < blender_bytes() <= 8 * 1024 * MIB
    monkeypatch.setenv("GMRDATA_BLENDER_FRAME_S", "7.5")
    assert blender_frame_s(10**9) == 7.5
    for wrong in ("much", "-1", "nan", "inf", "0"):
        monkeypatch.setenv("GMRDATA_BLENDER_GIB", wrong)
        with pytest.raises(BadRecipe, match=f"GMRDATA_BLENDER_GIB={wrong}: in the environment"):
            blender_bytes()
