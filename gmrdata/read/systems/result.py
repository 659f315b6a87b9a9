"""Reading a result of any known system; which one is told by what it holds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.read.amass_keys import FORMS, RATE_KEYS, gender_word, joined_poses
from gmrdata.read.numbers import kind_of
from gmrdata.read.safe_pickle import load_object_npy, load_plain
from gmrdata.read.systems import gem, gvhmr, phalp, prompthmr, sam3d, slahmr, tram, vibe, wham
from gmrdata.read.systems.entries import AGAIN, KNOWN, Entry, rotmats_of, turned
from gmrdata.read.torch_files import load_tensors
from gmrdata.values.body import HANDS, SMPL_REST_PELVIS_M, WORLD_FROM_REST
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.files import read_npz, require_text, taken_for
from gmrdata.values.people import (
    POSES_FILE,
    EstimatedPeople,
    EstimatedPerson,
    InCamera,
    InWorld,
    Part,
    load_local_poses,
    person_file,
)
from gmrdata.values.transforms import rotvecs_from_rotmats

POSES_FILES = (
    "wham_output.pkl", "hmr4d_results.pt", "vibe_output.pkl", "hpe_results.pt",
    "preprocess/hpe_results.pt", "smpl_params.pt", "results.pkl", "tcmr_output.pkl",
    "mpsnet_output.pkl", "GLoT_output.pkl", "pare_output.pkl", "meva_output.pkl",
)  # fmt: skip
"""What WHAM, GVHMR, VIBE, GEM-X, GEM-SMPL, PromptHMR and VIBE's kin call their results in the
folder that they make for a video."""
_PARAMS = {key for one in (gvhmr.GVHMR, gem.GEM) for key in (one.world, one.camera)}
ZIP = b"PK\3\4"  # how a file of torch.save begins, as each zip does
NUMPY = b"\x93NUMPY"
OLD_TORCH = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."  # and how before version 1.6
PICKLES = tuple(b"\x80 ( } ] x\x01 x^ x\x9c x\xda \x1f\x8b BZh \xfd7zXZ".split(b" "))
"""How pickles begin, as they are and packed."""
UNREAD = frozenset({"verts", "pred_vertices", "masks", "mask", "prhmr_img_feats"})
"""Keys that are not read and hold thousands of numbers in each frame: the meshes of VIBE, WHAM and
SAM 3D Body, the masks of PromptHMR and PHALP, and PromptHMR's features."""
MISSED: dict[Part, str] = {
    "poses": "no local poses",
    "camera": "no motion before the camera",
    "world": "no motion in the world",
}


def read_system(path: Path, need: Part = "poses") -> EstimatedPeople:
    """Read a file of one of `KNOWN`, or the folder that it made for a video, an `.npz` of TRAM, a
    motion with AMASS's keys, or the built-in estimator's folder; nothing of it is run.

    `need` is what each person must have; what a file has besides is read and checked too.

    Raises:
        MissingInput, BadMotionFile, BrokenPickle, UnsafePickle: name the file and the remedy.
    """
    require_text(path, BadMotionFile)
    estimate = _read(path)
    if not estimate.people:
        what = "has no person in it: nobody is seen in any frame"
        raise BadMotionFile(f"{path}: {what}. Give a file with tracked people")
    for person in estimate.people:
        if why := person.lacks.get(need):
            raise BadMotionFile(f"{path}: {person.name} has {why}, so {MISSED[need]}. {AGAIN}")
    return estimate


def result_file(path: Path) -> Path:
    """A system's own file in a folder that it made for a video; else the path as it is.

    BadMotionFile where there are two.
    """
    there = [path / name for name in POSES_FILES if (path / name).is_file()]
    if len(there) > 1:
        names = " and ".join(file.name for file in there)
        raise BadMotionFile(f"{path}: holds {names}. Leave the poses of one system there")
    return there[0] if there else path


def _read(path: Path) -> EstimatedPeople:
    path = result_file(path)
    if path.is_dir():
        own = (path / POSES_FILE).is_file()
        return _built_in(path) if own else tram.read_tram_folder(path)
    if not path.is_file():
        raise MissingInput(f"{path}: no such file. {KNOWN}")
    if path.suffix.lower() == ".npz":
        return _npz(path)
    with path.open("rb") as stream:
        first = stream.read(128)
    if first.startswith(ZIP):
        return _pickled(load_tensors(path), path)
    if first.startswith(OLD_TORCH):
        what = "is in torch's form from before version 1.6, which is not read"
        raise BadMotionFile(f"{path}: {what}. Load it with torch and save it again with torch.save")
    if first.startswith(NUMPY) and b"'|O'" in first:  # one of plain numbers is none of these
        return _pickled(load_object_npy(path), path)
    if not first.startswith(PICKLES):
        raise BadMotionFile(
            f"{path}: holds no poses{taken_for(path)}. {KNOWN}, .npz, .bvh and .amc"
        )
    return _pickled(load_plain(path, without=UNREAD), path)


def is_system_npz(arrays: Mapping[str, np.ndarray]) -> bool:
    """Whether arrays are a system's own, and not a motion with AMASS's keys."""
    own = "pred_rotmat" in arrays or arrays.keys() >= sam3d.KEYS
    return own or (arrays.keys() >= slahmr.KEYS and arrays["trans"].ndim == 3)


def files_beside(path: Path) -> dict[str, Path]:
    """What a file of poses is read with, by role: SLAHMR's alone is not whole in itself."""
    beside = slahmr.files_beside(path) if path.suffix.lower() == ".npz" else {}
    arrays = read_npz(path, plain_alone=True) if beside and path.is_file() else {}
    return beside if arrays.keys() >= slahmr.KEYS and is_system_npz(arrays) else {}


def _npz(path: Path) -> EstimatedPeople:
    arrays = read_npz(path, plain_alone=True)
    if "pred_rotmat" in arrays:
        return tram.read_tram_npz(arrays, path)
    if arrays.keys() >= sam3d.KEYS:
        return sam3d.read_sam3d(arrays, path)
    if is_system_npz(arrays) and not arrays.keys() >= AMASS_KEYS:
        return slahmr.read_slahmr(arrays, path)
    # In parts by AMASS's names, since others are of files before a camera too; or by joint.
    if arrays.keys() >= slahmr.KEYS or arrays.keys() >= AMASS_KEYS:
        arrays = joined_poses(arrays, path)
    if arrays.keys() >= AMASS_KEYS:
        return _with_amass_keys(arrays, path)
    what = "not TRAM's (pred_rotmat), not SLAHMR's (trans, root_orient, pose_body), no motion with"
    has = ", ".join(arrays)[:200]
    raise BadMotionFile(f"{path}: {what} AMASS's keys (poses, trans); it has {has}. {AGAIN}")


def _pickled(content: Any, path: Path) -> EstimatedPeople:
    if sam3d.are_rows(content):
        return sam3d.read_sam3d(content, path)
    if not isinstance(content, dict):
        raise _unknown(path, kind_of(content))
    if content.keys() >= prompthmr.KEYS:
        return prompthmr.read_prompthmr(content, path)
    if content.keys() & _PARAMS:
        is_gem = bool(content.keys() & {gem.GEM.world, gem.GEM.camera})
        return gem.read_gem(content, path) if is_gem else gvhmr.read_gvhmr(content, path)
    first = next(iter(content.values()), None)
    keys: set[Any] = set(first) if isinstance(first, Mapping) else set()
    if keys >= phalp.FRAME_KEYS:
        return phalp.read_phalp(content, path)
    if keys & set(wham.WORLD_KEYS) or keys >= set(wham.CAMERA_KEYS):
        return wham.read_wham(content, path)
    if keys & vibe.KEYS or not content:
        return vibe.read_vibe(content, path)
    if (motion := _plain_motion(content, path)) is not None:
        return _with_amass_keys(motion, path)
    kind = "its first entry"
    if not keys and isinstance(next(iter(content)), str):
        kind, keys = "it", set(content)
    has = ", ".join(sorted(key[:40] for key in keys if isinstance(key, str))[:12])
    raise _unknown(path, f"{kind} has: {has or 'no dict'}")


def _unknown(path: Path, has: str) -> BadMotionFile:
    what = f"holds no poses in a known form ({has})"
    return BadMotionFile(f"{path}: {what}. {KNOWN}, .npz, .bvh and .amc")


def _built_in(folder: Path) -> EstimatedPeople:
    """The folder of `gmrdata.people.local_poses`: before the video's own camera."""
    record, people = load_local_poses(folder)
    files = (folder / POSES_FILE, *(folder / person_file(n) for n in range(record.people)))
    estimated = [
        EstimatedPerson(
            name=f"person_{n}",
            frame_numbers=one.frame_numbers,
            local_rotmats=one.local_rotmats,
            in_camera=InCamera(one.root_rotmats, one.pelvis_m, "own", record.size_px),
            rest_pelvis_m=np.zeros(3),
            lacks={"world": "a motion before the camera alone"},
        )
        for n, one in enumerate(people)
    ]
    return EstimatedPeople("gmrdata", files, tuple(estimated))


AMASS_KEYS = frozenset({"poses", "trans"})
N_SMPLX = 165


def _with_amass_keys(arrays: dict[str, Any], path: Path) -> EstimatedPeople:
    """Any system's motion with AMASS's keys, at its own rate, as `gmrdata evaluate` takes it.

    `poses` (T, 66, 72, 156 or 165) axis-angle [rad], `trans` (T, 3), SMPL's transl [m] with z up;
    perhaps `betas` (S,) or (T, S), `gender`, `mocap_framerate` or `mocap_frame_rate` [Hz].
    `gmrdata.motion.amass` reads such files as motion capture: onto another body, on the floor.
    """
    entry = Entry(arrays, "the motion", path)
    poses = entry.array("poses", None, None)
    if poses.shape[1] not in HANDS:
        raise entry.fault(f"poses are {poses.shape}; known are {FORMS}")
    rotmats = rotmats_of(poses)[:, [*range(22), *HANDS[poses.shape[1]]]]
    transl_m, n_rows = entry.array("trans", len(poses), 3), len(poses)
    person = EstimatedPerson(
        name="person_0",
        frame_numbers=np.arange(n_rows),
        local_rotmats=rotmats[:, 1:],
        in_world=InWorld(rotmats[:, 0], transl_m, turned(np.eye(3), n_rows)),
        betas=None if poses.shape[1] == N_SMPLX else _mean_betas(entry, n_rows),
        betas_body=f"smpl-{gender_word(arrays)}",
        has_own_rate=True,
        lacks={"camera": "a motion in the world alone"},
    )
    return EstimatedPeople("amass", (path,), (person,), fps_hz=_rate_hz(entry))


def _plain_motion(content: dict[Any, Any], path: Path) -> dict[str, Any] | None:
    """A pickled motion by AMASS's keys: of MoSh (fullpose), or of AIST++, y up and scaled."""
    motion = {key: value for key, value in content.items() if isinstance(key, str)}
    if "fullpose" in motion:
        motion["poses"] = motion["fullpose"]
    match motion.get("stageii_debug_details"):  # of MoSh++'s own *_stageii.pkl
        case {"mocap_frame_rate": rate_hz, "cfg": {"surface_model": {"gender": gender}}}:
            motion |= {"mocap_frame_rate": rate_hz, "gender": gender}
    if motion.keys() >= {"smpl_poses", "smpl_trans", "smpl_scaling"}:
        entry = Entry(motion, "the motion", path)
        scaling = float(entry.flat("smpl_scaling", 1)[0])
        poses, trans = (entry.array(key, None, None) for key in ("smpl_poses", "smpl_trans"))
        if not scaling > 0 or poses.shape[1] != 72 or trans.shape[1] != 3:
            raise entry.fault(f"smpl_poses are {poses.shape}, smpl_scaling is {scaling:g}")
        roots = WORLD_FROM_REST @ rotmats_of(poses[:, :3])[:, 0]
        motion["poses"] = np.concatenate([rotvecs_from_rotmats(roots), poses[:, 3:]], axis=1)
        pelvis_m = (trans / scaling + SMPL_REST_PELVIS_M) @ WORLD_FROM_REST.T
        motion["trans"] = pelvis_m - SMPL_REST_PELVIS_M
    return motion if motion.keys() >= AMASS_KEYS else None


def _mean_betas(entry: Entry, n_rows: int) -> np.ndarray | None:
    """(T, S) one shape for all rows, the mean over time."""
    if not entry.has("betas"):
        return None
    by_row = entry.finite("betas").ndim == 2
    betas = entry.array("betas", None, None).mean(axis=0) if by_row else entry.array("betas", None)
    return np.tile(betas, (n_rows, 1))


def _rate_hz(entry: Entry) -> float | None:
    key = next((key for key in RATE_KEYS if entry.has(key)), None)
    if key is None:
        return None
    (rate_hz,) = entry.flat(key, 1)
    if not rate_hz > 0:
        raise entry.fault(f"{key} is no frame rate")
    return float(rate_hz)
