"""A synthetic set, rendered for real: a captured trial and an embedded gait."""

from pathlib import Path

import pytest

from gmrdata.errors import BadRecipe, MissingInput, StaleOutput
from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.read import load_clips, read_manifest
from gmrdata.synthetic.recipe import SyntheticRecipe
from gmrdata.synthetic.render_set import plan, render_set

pytestmark = pytest.mark.slow

RECIPE = SyntheticRecipe.model_validate(
    {
        "recipe": "synthetic",
        "name": "small",
        "seed": 3,
        "clips": [
            {"id": "run", "trial": "02_03", "programme": {"kind": "linear"}, "duration_s": 0.5},
            {"id": "step", "gait": "side_step", "programme": {"kind": "small"}},
            {"id": "gone", "trial": "99_99", "programme": {"kind": "static"}},
        ],
        "film": {"duration_s": 0.6, "fps_hz": 10, "width_px": 160, "height_px": 96},
        "render": {"samples": 1, "joints": True, "depth": True, "flow": True, "video": True},
    }
)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory, cmu_dir: Path, anny: object) -> Path:
    return render_set(RECIPE, tmp_path_factory.mktemp("set"), motions_dir=cmu_dir)


def test_the_manifest_is_good_and_lists_what_could_be_rendered(rendered: Path) -> None:
    check_manifest(rendered)
    manifest = read_manifest(rendered)
    assert [clip.id for clip in manifest.clips] == ["run", "step"]
    assert [clip.source.dataset for clip in manifest.clips] == ["CMU", "gmrdata"]
    assert [clip.motion.n_frames for clip in load_clips(rendered)] == [5, 6]
    assert manifest.clips[0].recipe is not None
    for clip, n_frames in zip(manifest.clips, (5, 6), strict=True):
        assert clip.depth is not None and clip.depth.count == n_frames
        assert clip.flow is not None and clip.flow.count == n_frames - 1
        assert clip.joints is not None and clip.video is not None and clip.normals is None


def test_once_more_does_nothing_and_another_seed_is_refused(rendered: Path, cmu_dir: Path) -> None:
    before = rendered.read_bytes()
    frame = rendered.parent / "render" / "run" / "frames" / "00000.jpg"
    made_ns = frame.stat().st_mtime_ns
    render_set(RECIPE, rendered.parent, motions_dir=cmu_dir)
    assert (rendered.read_bytes(), frame.stat().st_mtime_ns) == (before, made_ns)
    with pytest.raises(StaleOutput, match="config.seed"):
        render_set(RECIPE.model_copy(update={"seed": 4}), rendered.parent, motions_dir=cmu_dir)


def test_a_dry_run_says_what_is_done_and_what_is_missing(rendered: Path, cmu_dir: Path) -> None:
    _, rows = plan(RECIPE, cmu_dir, rendered.parent)
    assert [row[-1] for row in rows] == ["done", "done", "no motion file"]


def test_nothing_to_render_is_an_error(tmp_path: Path) -> None:
    trial = RECIPE.clips[0]
    with pytest.raises(MissingInput, match="--motions"):
        render_set(RECIPE.model_copy(update={"clips": (trial,)}), tmp_path)
    with pytest.raises(BadRecipe, match="no clips"):
        render_set(RECIPE.model_copy(update={"clips": ()}), tmp_path)
