"""How wrong a network is, measured on the people whom its recipe held out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gmrdata.cli import main
from gmrdata.fusion import network_errors
from gmrdata.fusion.network_errors import (
    MeasureConfig,
    beside_truth,
    error_rates,
    held_out_motions,
)
from gmrdata.fusion.network_evidence import DeltaErrors
from gmrdata.gmr.config import DataConfig, TrainConfig
from gmrdata.gmr.predict import TrainedGmr
from gmrdata.gmr.train import train
from gmrdata.read.body_file import save_body
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadManifest
from tests.clip_manifests import write_clips


@pytest.fixture
def cmu_clips(make_clips: Callable[..., list[Clip]]) -> list[Clip]:
    names = ("02_01", "02_02", "05_01")
    return [replace(clip, id=name) for clip, name in zip(make_clips(3, 1), names, strict=True)]


def test_the_verb_measures_a_run_on_whom_it_held_out(
    cmu_clips: list[Clip],
    small_body: BodyModel,
    small_config: TrainConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    manifest = write_clips(tmp_path / "cmu", small_body, cmu_clips, dataset="CMU")
    save_body(tmp_path / "body.npz", small_body)
    held_out = DataConfig(held_out_subjects=(2,))
    config = small_config.model_copy(update={"data": held_out, "steps": 2})
    run_dir = train([manifest], tmp_path / "run", config, body_path=tmp_path / "body.npz")
    out = run_dir / "delta_errors.json"
    words = ["delta-errors", str(manifest), "--network", str(run_dir), "--out", str(out)]
    with pytest.raises(SystemExit):
        main(words)  # eight seconds are too few
    assert "Hold out more of them" in capsys.readouterr().err.replace("\n", " ")
    monkeypatch.setattr(network_errors, "FEWEST_S", 1.0)
    main(words)
    record = DeltaErrors.read(out)
    assert (record.people, record.clips, record.networks) == (("CMU/02",), 2, ("run",))
    assert record.seconds == pytest.approx(8.0, abs=0.5)
    assert np.array(record.fast.place_m_per_s).max() > 0.05
    nobody = config.model_copy(update={"data": DataConfig()})
    other = train([manifest], tmp_path / "other", nobody, body_path=tmp_path / "body.npz")
    with pytest.raises(BadManifest, match="held none of these clips out"):
        held_out_motions(other, [manifest])
    said = held_out_motions(other, [manifest], people=("2",))
    assert [(one.clip, one.person) for one in said] == [("02_01", "CMU/02"), ("02_02", "CMU/02")]


def test_noise_is_put_on_what_the_network_sees_alone(
    cmu_clips: list[Clip], untrained: TrainedGmr
) -> None:
    clip, rng = cmu_clips[0], np.random.default_rng(0)
    exact, noisy = (
        next(beside_truth(untrained, clip, MeasureConfig(pose_noise_deg=deg), rng))
        for deg in (0.0, 10.0)
    )
    np.testing.assert_array_equal(exact.true_pelvis_m, noisy.true_pelvis_m)
    assert exact.fps_hz == clip.motion.fps_hz == 20.0
    assert np.abs(error_rates(exact) - error_rates(noisy)).max() > 0.01
