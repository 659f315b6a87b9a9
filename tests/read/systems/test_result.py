"""Broken results of other systems are refused with the file, whatever part of them is broken."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from gmrdata.read.systems.result import read_system
from gmrdata.values.errors import BadMotionFile, GmrdataError, MissingInput
from tests.joblib_layout import joblib_bytes
from tests.read import system_files

T = 4


def vibe(path: Path, **change: Any) -> Path:
    person = system_files.vibe_person(T)
    person = {key: person[key] for key in ("pose", "betas", "orig_cam", "frame_ids")}
    return system_files.write_joblib(path / "vibe_output.pkl", {1: _changed(person, change)})


def gvhmr(path: Path, **change: Any) -> Path:
    params = system_files.gvhmr_params(np.zeros((T, 63)), np.zeros((T, 3)), np.zeros((T, 3)))
    person = _changed({key: one.numpy() for key, one in params.items()}, change)
    tensors = {key: torch.from_numpy(np.asarray(value)) for key, value in person.items()}
    content = {"smpl_params_global": tensors}
    return system_files.write_torch(path / "hmr4d_results.pt", content)


def tram(path: Path, **change: Any) -> Path:
    people = {
        "pred_rotmat": np.tile(np.eye(3), (T, 24, 1, 1)),
        "pred_shape": np.zeros((T, 10)),
        "pred_trans": np.zeros((T, 1, 3)),
        "frame": np.arange(T),
    }
    camera = {"world_cam_R": np.tile(np.eye(3), (T, 1, 1)), "world_cam_T": np.zeros((T, 3))}
    (path / "hps").mkdir(exist_ok=True)
    both = _changed(people | camera, change)
    for name, keys in (("camera.npy", camera), ("hps/hps_track_0.npy", people)):
        kept = {key: both[key] for key in keys if key in both}
        np.save(path / name, kept)  # type: ignore[arg-type]  # as TRAM does
    return path


def slahmr(path: Path, **change: Any) -> Path:
    arrays = {
        "trans": np.zeros((2, T, 3)),
        "root_orient": np.zeros((2, T, 3)),
        "pose_body": np.zeros((2, T, 63)),
        "betas": np.zeros((2, 16)),
        "cam_R": np.tile(np.eye(3), (2, T, 1, 1)),
        "cam_t": np.zeros((2, T, 3)),
    }
    tracks = ", ".join(f'"{n}": {{"index": {n}, "vis_mask": {[1] * T}}}' for n in range(2))
    meta = f'{{"seq_interval": [0, {T}], "data_interval": [0, {T}]}}'
    (path / "track_info.json").write_text(f'{{"tracks": {{{tracks}}}, "meta": {meta}}}')
    np.savez(path / "x_000040_world_results.npz", **_changed(arrays, change))
    return path / "x_000040_world_results.npz"


def amass(path: Path, **change: Any) -> Path:
    arrays = {"poses": np.zeros((T, 72)), "trans": np.zeros((T, 3)), "mocap_framerate": 30.0}
    np.savez(path / "x.npz", **_changed(arrays, change))
    return path / "x.npz"


def test_vibe_saw_a_tenth_more_than_its_box(tmp_path: Path) -> None:
    """A box of 200 px whose middle is 100 px right of that of 640x480 px, as demo.py writes it."""
    crop, half_px = np.array([0.8, 0.1, -0.2]), np.array([320, 240])
    scales = crop[0] * 200 / (2 * half_px)
    person = {
        "pose": np.zeros((1, 72)),
        "betas": np.zeros((1, 10)),
        "orig_cam": np.r_[scales, np.array([100, 0]) / half_px / scales + crop[1:]][None],
        "pred_cam": crop[None],
        "frame_ids": np.arange(1),
    }
    box_alone = {key: value for key, value in person.items() if key != "pred_cam"}
    path = tmp_path / "vibe_output.pkl"
    path.write_bytes(joblib_bytes({1: person, 2: box_alone}))
    first, second = (one.in_camera for one in read_system(path).people)
    assert first is not None and first.in_picture is not None and second is not None
    ((*scales, tx, ty),) = first.in_picture
    # Of the crop of 220 px, a point at (X, Y) is 110 s (X + tx) right of the middle.
    assert half_px * scales == pytest.approx(110 * 0.8)
    at_px = half_px * scales * np.array([0.3 + tx, 0.4 + ty])
    assert at_px == pytest.approx([100 + 110 * 0.8 * (0.3 + 0.1), 110 * 0.8 * (0.4 - 0.2)])
    # Without `pred_cam` people stay where they are in the picture.
    wider = person["orig_cam"] * [1.1, 1.1, 1 / 1.1, 1 / 1.1]
    np.testing.assert_allclose(second.in_picture, wider)


WRITERS: dict[str, tuple[Callable[..., Path], tuple[str, ...]]] = {
    "vibe": (vibe, ("pose", "betas", "orig_cam", "frame_ids")),
    "gvhmr": (gvhmr, ("body_pose", "global_orient", "transl")),
    "tram": (
        tram,
        ("pred_rotmat", "pred_shape", "pred_trans", "frame", "world_cam_R", "world_cam_T"),
    ),
    "slahmr": (slahmr, ("trans", "root_orient", "pose_body", "betas", "cam_R", "cam_t")),
    "amass": (amass, ("poses", "trans", "mocap_framerate")),
}
OPTIONAL = {"frame", "mocap_framerate", "cam_R", "cam_t"}
PARTS = [(system, key) for system, (_, keys) in WRITERS.items() for key in keys]


def _changed(arrays: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    for key, how in change.items():
        value = np.asarray(arrays[key], dtype=float)
        if how == "nan":
            arrays[key] = np.where(np.arange(value.size).reshape(value.shape) == 0, np.nan, value)
        elif how == "short":
            arrays[key] = value[:-1] if value.ndim else np.zeros(3)
        elif how == "flat":
            arrays[key] = value.ravel()[:-1] if value.ndim else np.zeros(0)
        else:
            del arrays[key]
    return arrays


@pytest.mark.parametrize("system", WRITERS)
def test_whole_results_are_read(system: str, tmp_path: Path) -> None:
    found = read_system(WRITERS[system][0](tmp_path), "world")
    assert found.system == system
    assert [len(one.frame_numbers) for one in found.people] == [T] * len(found.people)


@pytest.mark.parametrize(("system", "key"), PARTS)
@pytest.mark.parametrize("how", ["nan", "short", "flat", "gone"])
def test_a_broken_part_is_refused(system: str, key: str, how: str, tmp_path: Path) -> None:
    path = WRITERS[system][0](tmp_path, **{key: how})
    if how == "gone" and key in OPTIONAL:
        assert read_system(path, "world").people
        return
    with pytest.raises(GmrdataError, match=str(tmp_path)) as refused:
        read_system(path, "world")
    assert type(refused.value) in (BadMotionFile, MissingInput)


def test_a_folder_that_is_no_result_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match=r"no camera\.npy and hps/hps_track_<k>\.npy"):
        read_system(tmp_path)
    np.savez(tmp_path / "x.npz", other=np.zeros(3))
    with pytest.raises(BadMotionFile, match=r"x\.npz: not TRAM's .* it has other"):
        read_system(tmp_path / "x.npz")
    (tmp_path / "x.pkl").write_bytes(joblib_bytes({1: {"pose": np.zeros((T, 72))}}))
    with pytest.raises(BadMotionFile, match=r"x\.pkl: person_1 has no 'frame_ids\'"):
        read_system(tmp_path / "x.pkl")
