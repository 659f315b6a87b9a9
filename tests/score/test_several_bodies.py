"""AMASS and EMDB with people of all genders: one import each, one training, one scoring."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.gmr.config import ModelConfig, TrainConfig, WindowConfig
from gmrdata.gmr.train import train
from gmrdata.manifest.read import load_clips
from gmrdata.motion.emdb import make_emdb
from gmrdata.motion.library import make_library
from gmrdata.read.bodies import load_bodies
from gmrdata.read.body_file import save_body
from gmrdata.score.predictors import ScoreConfig
from gmrdata.score.records import Scores
from gmrdata.score.score import score
from gmrdata.stage.run import Run
from gmrdata.values.body import body_of, with_vertices
from gmrdata.values.clip import save_clip
from gmrdata.values.errors import BadBodyFile, BadManifest, BadMotionFile
from gmrdata.write.amass import write_amass
from tests.motion.test_emdb import content, write_sequence
from tests.smpl_models import write_smpl_folder

GENDERS = ("female", "male", "neutral")
HERE = Run(workers=1)
CONFIG = TrainConfig(
    model=ModelConfig(layers=1, hidden=8), windows=WindowConfig(frames=4), batch_size=6, steps=2
)

FEW = ScoreConfig(resamples=100)


def amass_arrays(gender: str) -> dict[str, Any]:
    rng = np.random.default_rng(GENDERS.index(gender))
    poses = np.zeros((40, 52, 3))
    start, speed = rng.normal(0, 0.2, (2, 24, 3))
    poses[:, [*range(22), 22, 37]] = start + np.linspace(0, 1, 40)[:, None, None] * speed
    poses[:, 0, 0] += np.pi / 2
    return {
        "poses": poses.reshape(40, 156),
        "trans": np.linspace([0.1, 0.2, 0.9], [0.5, 0.4, 0.95], 40),
        "betas": rng.normal(0, 0.7, 16),
        "gender": gender,
        "mocap_framerate": 60.0,
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory, small_body) -> Path:
    """`smpl`, `amass/motions.yaml` and `emdb/emdb.yaml`."""
    root = tmp_path_factory.mktemp("several_bodies")
    write_smpl_folder(root / "smpl", small_body)
    for gender in GENDERS:
        path = root / "AMASS" / "KIT" / "3" / f"{gender}_poses.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **amass_arrays(gender))
    make_library((root / "AMASS",), str(root / "smpl"), root / "amass", run=HERE)
    for number, gender in enumerate(GENDERS):
        name = f"P{number}_0{number}_walk"
        write_sequence(root / "EMDB", content(name, gender), name)
    make_emdb(root / "EMDB", str(root / "smpl"), root / "emdb")
    return root


def test_amass_keeps_all_betas_and_comes_out_as_it_went_in(made, tmp_path):
    bodies = load_bodies(str(made / "smpl"))
    for clip in load_clips(made / "amass" / "motions.yaml"):
        arrays = amass_arrays(clip.motion.gender)
        np.testing.assert_array_equal(clip.motion.shape, arrays["betas"])
        body = body_of(clip.motion, bodies)
        assert body is not None and body.name == f"smpl-{clip.motion.gender}"
        write_amass(tmp_path / "again.npz", clip.motion, body)
        with np.load(tmp_path / "again.npz", allow_pickle=False) as again:
            for key in ("poses", "trans", "betas"):
                np.testing.assert_allclose(again[key], arrays[key], atol=1e-7, err_msg=key)
            assert (again["gender"], again["mocap_framerate"]) == (arrays["gender"], 60.0)


def test_one_training_and_one_scoring(made, tmp_path):
    manifests = [made / "amass" / "motions.yaml", made / "emdb" / "emdb.yaml"]
    smpl = made / "smpl"
    run_dir = train(manifests, tmp_path / "run", CONFIG, body_path=smpl, held_out_paths=manifests)
    scores_path = score(run_dir, manifests[1], tmp_path / "scores", FEW, body_path=smpl).scores[0]
    scores = Scores.read(scores_path)
    assert scores.body == "smpl-female, smpl-male, smpl-neutral"
    assert len(scores.clips) == 3
    # Where a stage keeps bodies is such a folder as well.
    of_stage = score(
        run_dir, manifests[1], tmp_path / "kept", FEW, body_path=made / "emdb" / "body"
    )
    kept = Scores.read(*of_stage.scores)
    for one, other in zip(scores.clips, kept.clips, strict=True):
        assert one.predicted.vme_mm == pytest.approx(other.predicted.vme_mm, rel=1e-5)


def test_each_prediction_is_posed_on_its_own_body(made, tmp_path):
    """A perfect prediction has no error; the same on another gender's body has one."""
    manifest, bodies = made / "emdb" / "emdb.yaml", load_bodies(str(made / "smpl"))
    for clip in load_clips(manifest):
        body = body_of(clip.motion, bodies)
        assert body is not None
        folder = tmp_path / "predictions"
        folder.mkdir(exist_ok=True)
        save_clip(folder / f"{clip.id}.npz", clip, body.rest_pelvis_m(np.zeros(16)))
    config = ScoreConfig(fps_hz=30.0, resamples=100)
    found = score(folder, manifest, tmp_path / "scores", config, body_path=made / "smpl").scores[0]
    assert all(clip.predicted.vme_mm < 1e-4 for clip in Scores.read(found).clips)


def test_without_the_body_of_a_gender_the_neutral_one_stands_in(made, small_body, tmp_path):
    folder = tmp_path / "smpl"
    write_smpl_folder(folder, small_body, n_shape=12)
    (folder / "male" / "model.npz").unlink()
    library = make_library((made / "AMASS",), str(folder), tmp_path / "amass", run=HERE)
    female, male, neutral = (clip.motion for clip in load_clips(library))
    assert [one.body for one in (female, male, neutral)] == [
        "smpl-female",
        "smpl-neutral",
        "smpl-neutral",
    ]
    assert "the first 12 betas of the file" in female.source
    np.testing.assert_array_equal(female.shape, amass_arrays("female")["betas"][:12])
    assert "not used, which are of smpl-male, path x 1.0000" in male.source
    np.testing.assert_array_equal(male.shape, np.zeros(12))
    manifest = made / "amass" / "motions.yaml"
    with pytest.raises(BadManifest, match="smpl-female with 16 shape .*folder with the bodies"):
        train([manifest], tmp_path / "run", CONFIG, body_path=folder)
    write_smpl_folder(tmp_path / "two", small_body)
    (tmp_path / "two" / "SMPL_NEUTRAL.npz").unlink()
    with pytest.raises(BadMotionFile, match="needs the body smpl-neutral; there are"):
        make_library((made / "AMASS",), str(tmp_path / "two"), tmp_path / "none", run=HERE)


def test_bodies_of_different_meshes_are_refused(made, small_body, tmp_path):
    folder = tmp_path / "smpl"
    write_smpl_folder(folder, small_body)
    (folder / "male" / "model.npz").unlink()
    few = with_vertices(small_body, np.arange(40))
    save_body(folder / "x.npz", replace(few, name="smpl-male", faces=small_body.faces[:4]))
    with pytest.raises(BadBodyFile, match="meshes or shapes of different sizes"):
        train([made / "amass" / "motions.yaml"], tmp_path / "run", CONFIG, body_path=folder)
