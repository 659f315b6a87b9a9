"""`gmrdata export` to EMDB's files, other systems' results and ONNX, and what it refuses."""

import json
import pickle  # noqa: TID251  The oracle: what others open the files with.
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from gmrdata.cli import main
from gmrdata.gmr.predict import load_gmr, predict_deltas
from gmrdata.motion.emdb import ABOUT_FILE, EmdbAbout
from gmrdata.read.body_file import save_body
from gmrdata.read.emdb import read_emdb
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.motion import Motion
from tests.clip_manifests import write_clips


def export(*arguments: object) -> int:
    """Exit code of the verb."""
    try:
        main(["export", *map(str, arguments)])
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


@pytest.fixture
def manifest(walkers: list[Clip], small_body: BodyModel, tmp_path: Path) -> Path:
    """A woman on SMPL's body: a clip from image 0 on, one from image 5 on, one not valid at all."""
    first = walkers[0]
    body = replace(small_body, name="smpl-female")
    named = replace(first, motion=replace(first.motion, body=body.name, gender="female"))
    n = np.arange(first.motion.n_frames)
    clips = [
        replace(named, id="P1_14_outdoor_climb", image_numbers=n),
        replace(named, id="late", image_numbers=n + 5),
        replace(named, id="rejected", valid=n < 0),
    ]
    folder = tmp_path / "in"
    save_body(folder / "body" / "body.npz", body)
    return write_clips(folder, body, clips, camera_motions=["circular"] * 3)


def test_files_where_others_look_for_them(
    manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, name = tmp_path / "out", "P1_14_outdoor_climb"
    about = EmdbAbout(emdb1=True, emdb2=False, reasons=[""] * 30)
    about.write(manifest.parent / ABOUT_FILE)
    assert export(manifest, "--to", "emdb", "wham", "gvhmr", "3dpw", "--out", out) == 1
    said = capsys.readouterr().err
    files = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    assert files == [
        f"3dpw/sequenceFiles/test/{name}.pkl",
        f"emdb/P1/14_outdoor_climb/{name}_data.pkl",
        f"gvhmr/{name}/hmr4d_results.pt",
        f"wham/{name}/wham_output.pkl",
        "wham/late/wham_output.pkl",
    ]
    emdb = read_emdb(out / "emdb" / "P1" / "14_outdoor_climb" / f"{name}_data.pkl")
    assert (emdb.name, emdb.gender, emdb.emdb1, emdb.emdb2) == (name, "female", True, False)
    late = pickle.loads((out / "wham" / "late" / "wham_output.pkl").read_bytes())[0]
    assert late["frame_ids"].tolist() == [n + 5 for n in range(30) if n not in (10, 11, 12)]
    whole = torch.load(out / "gvhmr" / name / "hmr4d_results.pt", weights_only=True)
    assert np.flatnonzero(~whole["valid"].numpy()).tolist() == [10, 11, 12]
    for line in (
        "late: no emdb: clip late: row 0 is image 5",
        "late: no 3dpw: clip late: row 0 is image 5",
        "late: no gvhmr: row 0 is frame 5 of the video",
        "rejected: no wham: has no valid frame",
        "rejected: no 3dpw: has no valid frame",
        "rejected: no gvhmr: has no valid frame",
    ):
        assert line in said


def test_a_network(
    run_dir: Path,
    walk: Callable[..., Motion],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    path = out / "onnx" / "run.onnx"
    assert export(run_dir, "--to", "onnx", "--out", out, "--dry-run") == 0 and not out.exists()
    assert export(run_dir, "--to", "onnx", "--out", out) == 0
    local_rotmats = walk(10.0, 12).local_rotmats
    session = onnxruntime.InferenceSession(path)
    found = session.run(None, {"local_rotmats": local_rotmats[None].astype(np.float32)})
    for one, wanted in zip(found, predict_deltas(load_gmr(run_dir), local_rotmats), strict=True):
        assert np.abs(one[0] - wanted).max() < 1e-5
    assert export(run_dir, "--to", "onnx", "--out", out) == 1
    assert "already there. Pass --redo" in capsys.readouterr().err
    assert export(run_dir, "--to", "onnx", "--out", out, "--redo") == 0


def test_what_is_no_network_is_refused(
    run_dir: Path, manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert export(run_dir, "--to", "onnx", "tum", "--out", out) == 1
    assert "Export it alone" in capsys.readouterr().err
    assert export(manifest.parent, "--to", "onnx", "--out", out) == 1
    assert "no trained model there" in capsys.readouterr().err
    assert export(run_dir, "--to", "onnx", "--which", "best", "--out", out) == 1
    assert "no best weights" in capsys.readouterr().err
    (state_path,) = run_dir.glob("checkpoints/step_*/state.json")
    state_path.write_text(json.dumps({"format": "gmrdata-joint/2", "step": 1, "body": "anny"}))
    assert export(run_dir, "--to", "onnx", "--out", out) == 1
    assert "gmrdata-joint/2" in capsys.readouterr().err
    assert not out.exists()
