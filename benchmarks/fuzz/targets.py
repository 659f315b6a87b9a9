"""The readers, each with files that it reads."""

import json
import pickle  # noqa: TID251  The measurement writes the pickles that are to be read.
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from fuzz import mutations as change
from fuzz.mutations import Mutation
from fuzz.runs import Target
from onnx import TensorProto, helper

from gmrdata.cameras.files import CamerasQuality
from gmrdata.cli.demo_recipe import DemoRecipe
from gmrdata.film.character import linked_files
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.gmr.checkpoint import GmrState, read_model, save_step
from gmrdata.gmr.config import ModelConfig
from gmrdata.gmr.model import Gmr
from gmrdata.gmr.train import GmrRecipe
from gmrdata.manifest.read import load_clips
from gmrdata.motion.files import read_motion
from gmrdata.motion.local_poses import read_local_poses
from gmrdata.pages.scores import scores_page
from gmrdata.people import onnx
from gmrdata.people.sources import MasksRecipe
from gmrdata.read import emdb, human36m, openpose
from gmrdata.read.amc import read_amc
from gmrdata.read.bodies import read_smpl
from gmrdata.read.body_file import read_body, save_body
from gmrdata.read.frames import check_images, list_images, read_color, read_gray
from gmrdata.read.systems.result import read_system
from gmrdata.read.threedpw_files import SequenceArrays, read_sequence_file
from gmrdata.score.compare import CompareConfig, compare_records
from gmrdata.score.records import Scores
from gmrdata.score.table import scores_markdown
from gmrdata.stage.recipes import load_recipe, recipe_path
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.twins.twin_set import TwinRecipe
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip, load_clip
from gmrdata.values.motion import Motion
from gmrdata.values.records import Config
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.write.threedpw import write_sequence
from tests import reconstructions
from tests.clip_manifests import write_clips
from tests.motion.test_emdb import content as emdb_content
from tests.read import system_files
from tests.read.systems import test_result
from tests.read.test_amc import AMC, ASF
from tests.score.score_records import clip_score, metrics, scores
from tests.smpl_models import smpl_arrays

RECIPES: Mapping[str, type[Config]] = {
    "demo": DemoRecipe, "synthetic": SyntheticRecipe, "threedpw": ThreedpwRecipe, "gmr": GmrRecipe,
    "masks": MasksRecipe, "twins": TwinRecipe,
}  # fmt: skip


def targets(
    folder: Path,
    body: BodyModel,
    walkers: Sequence[Clip],
    sequence: SequenceArrays,
    write_person: Any,
) -> list[Target]:
    """Every reader.  Their files are made in `folder`."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    made = _Made(folder)
    return [
        *_motions(made, body, write_person),
        *_clips(made, body, walkers),
        *_recipes(made),
        *_records(made),
        *_pickles(made, body, walkers, sequence),
        *_systems(made, body, walkers),
        *_pictures(made),
        *_networks(made),
        _character(made),
        *_texts(made),
    ]


class _Made:
    """A folder in which files are made to be taken as bytes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "seeds"

    def place(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def all_in(self, name: str) -> dict[str, bytes]:
        root = self.folder / name
        return {
            path.relative_to(root).as_posix(): path.read_bytes()
            for path in sorted(root.rglob("*"))
            if path.is_file() and not path.name.startswith(".")
        }


def _one(
    name: str, file: str, data: bytes, ways: Sequence[Mutation], read: Callable[[Path], Any]
) -> Target:
    """A reader of a single file."""
    return Target(name, {file: data}, {file: ways}, lambda folder: read(folder / file))


def _finite(motion: Motion) -> None:
    for what, array in vars(motion).items():
        if isinstance(array, np.ndarray) and not np.isfinite(array).all():
            raise ValueError(f"{what} of a motion is not finite")


def _motions(made: _Made, body: BodyModel, write_person: Any) -> list[Target]:
    rng = np.random.default_rng(2)
    angles_deg = rng.normal(scale=9.0, size=(6, 24, 3))
    pelvis_m = np.linspace([0.0, 0.9, 0.0], [0.5, 0.9, 0.1], 6)
    bvh = write_person(made.place("a.bvh"), body, angles_deg, pelvis_m).read_bytes()
    poses = system_files.some_poses(6)
    amass: dict[str, Any] = {
        "poses": poses, "trans": pelvis_m, "betas": np.zeros(16), "gender": "male",
        "mocap_framerate": 120.0,
    }  # fmt: skip
    np.savez(made.place("a.npz"), **amass)

    def read(path: Path) -> None:
        _finite(read_motion(path, body))

    asf_amc = {"07.asf": ASF.encode(), "07_01.amc": AMC.encode()}

    def amc(path: Path) -> None:
        found = read_amc(path / "07_01.amc", fps_hz=60)
        if not (np.isfinite(found.local_rotmats).all() and np.isfinite(found.translations_m).all()):
            raise ValueError("a pose is not finite")

    return [
        _one("bvh", "a.bvh", bvh, change.TEXT, read),
        Target("amc", asf_amc, dict.fromkeys(asf_amc, change.TEXT), amc),
        _one("amass", "a.npz", made.place("a.npz").read_bytes(), change.NPZ, read),
    ]


def _clips(made: _Made, body: BodyModel, walkers: Sequence[Clip]) -> list[Target]:
    write_clips(made.place("clips/x").parent, body, walkers)
    files = made.all_in("clips")
    clip = next(data for name, data in files.items() if name.endswith(".npz"))
    save_body(made.place("body.npz"), body)
    return [
        _one("clip", "a.npz", clip, change.NPZ, load_clip),
        Target(
            "manifest", files, {"manifest.yaml": change.YAML},
            lambda folder: load_clips(folder / "manifest.yaml"),
        ),
        _one("body", "a.npz", made.place("body.npz").read_bytes(), change.NPZ, read_body),
    ]  # fmt: skip


def _load_recipe(kind: type[Config], path: Path) -> Config:
    return load_recipe(path, kind)


def _recipes(made: _Made) -> list[Target]:
    return [
        _one(
            f"recipe_{name}", "a.yaml", recipe_path(name).read_bytes(), change.YAML,
            partial(_load_recipe, kind),
        )
        for name, kind in RECIPES.items()
    ]  # fmt: skip


def _records(made: _Made) -> list[Target]:
    clips = [clip_score(f"walk {n}", metrics(1.0 + n, 10.0, 20.0)) for n in range(3)]
    whole = scores(clips)
    whole.write(made.place("scores.json"))
    quality = reconstructions.good_quality(8)
    quality.write(made.place("cameras.json"))
    reconstructions.pseudo_gt_quality(quality, 1.1).write(made.place("quality.json"))

    def of(kind: Any) -> Callable[[Path], Any]:
        return lambda path: kind.read(path).write(path)

    def read_scores(path: Path) -> None:
        found = Scores.read(path)
        scores_markdown(found)
        compare_records([whole, found], [path, path], ["a", "b"], CompareConfig())
        scores_page(found)

    readers = {
        "scores": read_scores,
        "cameras": of(CamerasQuality),
        "quality": of(PseudoGtQuality),
    }
    return [
        _one(name, f"{name}.json", made.place(f"{name}.json").read_bytes(), change.JSON, read)
        for name, read in readers.items()
    ]


def _pickles(
    made: _Made, body: BodyModel, walkers: Sequence[Clip], sequence: SequenceArrays
) -> list[Target]:
    files = write_sequence(made.place("3dpw/x").parent, "train", sequence)
    smpl = smpl_arrays(body, 1.0, 10)
    np.savez(made.place("smpl.npz"), **smpl)  # type: ignore[arg-type]
    frames = [
        system_files.phalp_frame(t, {1: p, 2: p}) for t, p in enumerate(system_files.phalp_poses(4))
    ]
    phalp = system_files.write_phalp(made.place("phalp.pkl"), frames).read_bytes()
    plain_phalp = pickle.dumps({frame["frame_path"]: frame for frame in frames})
    wham = pickle.dumps(dict(system_files.some_wham({1: 5, 2: 4})))
    vibe = pickle.dumps({1: system_files.vibe_person(5)})

    def poses(path: Path) -> None:
        for clip in read_local_poses(path, 30.0, body=body):
            _finite(clip.motion)

    packed = (change.changed_packed, change.changed_bytes)
    pickles = change.PICKLE
    return [
        _one(
            "3dpw",
            "a.pkl",
            files.pickle_path.read_bytes(),
            (change.changed_bytes,),
            read_sequence_file,
        ),
        _one("3dpw_values", "a.pkl", _plain_3dpw(files.pickle_path), pickles, read_sequence_file),
        _one("emdb", "P0_a_data.pkl", pickle.dumps(emdb_content()), pickles, emdb.read_emdb),
        _one("smpl", "basicmodel_m_lbs.pkl", pickle.dumps(smpl), pickles, read_smpl),
        _one(
            "smpl_npz", "SMPL_MALE.npz", made.place("smpl.npz").read_bytes(), change.NPZ, read_smpl
        ),
        _one("phalp_packed", "a.pkl", phalp, packed, poses),
        _one("phalp", "a.pkl", plain_phalp, pickles, poses),
        _one("wham", "a.pkl", wham, pickles, poses),
        _one("wham_world", "a.pkl", wham, pickles, read_system),
        _one("vibe", "a.pkl", vibe, pickles, poses),
        _one("vibe_world", "a.pkl", vibe, pickles, read_system),
    ]


def _plain_3dpw(path: Path) -> bytes:
    return pickle.dumps(pickle.loads(path.read_bytes(), encoding="latin1"), 2)


def _systems(made: _Made, body: BodyModel, walkers: Sequence[Clip]) -> list[Target]:
    motion, camera = walkers[0].motion, walkers[0].camera
    assert camera is not None
    rest_m, frames = np.zeros(3), np.arange(motion.n_frames)
    system_files.write_torch(made.place("gvhmr.pt"), system_files.some_gvhmr(5))
    gvhmr = made.place("gvhmr.pt").read_bytes()
    gem = test_result.gem(made.place("gem/x").parent).read_bytes()
    rows = test_result.sam3d_rows()
    np.savez(made.place("rows.npz"), **rows)
    pictures = [{key: value[t] for key, value in rows.items()} for t in range(test_result.T)]
    sam3d = pickle.dumps([[{**one, "person_id": 1}] for one in pictures])
    system_files.write_tram(made.place("tram/x").parent, motion, camera, frames, rest_m)
    system_files.write_slahmr(made.place("slahmr/x").parent, {0: motion}, camera, rest_m)
    tram, slahmr = made.all_in("tram"), made.all_in("slahmr")
    result = "motion_chunks/x_000040_world_results.npz"

    def poses(path: Path) -> None:
        for clip in read_local_poses(path, 30.0, body=body):
            _finite(clip.motion)

    tensors = (
        change.changed_torch,
        change.changed_torch,
        change.changed_member,
        change.changed_bytes,
    )
    return [
        _one("gvhmr", "a.pt", gvhmr, tensors, poses),
        _one("gvhmr_world", "a.pt", gvhmr, tensors, read_system),
        _one("gem", "a.pt", gem, tensors, read_system),
        _one("sam3d", "a.pkl", sam3d, change.PICKLE, read_system),
        _one("sam3d_npz", "a.npz", made.place("rows.npz").read_bytes(), change.NPZ, read_system),
        Target("tram", tram, dict.fromkeys(tram, change.OBJECT), read_system),
        Target(
            "slahmr", slahmr, {result: change.NPZ, "track_info.json": change.JSON},
            lambda folder: read_system(folder / result),
        ),
    ]  # fmt: skip


def _pictures(made: _Made) -> list[Target]:
    noise = np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    files = {}
    for suffix in ("png", "jpg"):
        for number in range(2):
            files[f"{number}.{suffix}"] = cv2.imencode(f".{suffix}", noise)[1].tobytes()
    mask = cv2.imencode(".png", noise[..., 0])[1].tobytes()

    def frames(folder: Path) -> None:
        images = list_images(folder)
        size_px = check_images(images)
        for path in images:
            if read_color(path).shape != (*size_px[::-1], 3):
                raise ValueError("an image of another size than its header says")

    png = (change.changed_png, change.changed_bytes)
    return [
        Target("png", {n: d for n, d in files.items() if "png" in n}, {"1.png": png}, frames),
        Target("jpg", {n: d for n, d in files.items() if "jpg" in n},
               {"1.jpg": (change.changed_bytes,)}, frames),
        _one("mask", "0.png", mask, png, lambda path: read_gray(path, (32, 24))),
    ]  # fmt: skip


def _networks(made: _Made) -> list[Target]:
    value = helper.make_tensor_value_info("images", TensorProto.FLOAT, (1, 3, 64, 64))
    out = helper.make_tensor_value_info("out", TensorProto.FLOAT, (1, 3, 64, 64))
    node = helper.make_node("Relu", ["images"], ["out"])
    network = helper.make_model(helper.make_graph([node], "g", [value], [out])).SerializeToString()
    run = made.place("run/x").parent
    model = Gmr(ModelConfig(layers=1, hidden=4))
    optimizer = torch.optim.Adam(model.parameters())
    sum(p.sum() for p in model.parameters()).backward()  # type: ignore[union-attr]
    optimizer.step()
    state = GmrState(
        step=3,
        body="small",
        model=model.config,
        fps_hz=10.0,
        processes=1,
        averaged=False,
        best=None,
    )
    folder = save_step(run, state, model, optimizer)
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    ways = {"state.json": change.JSON, "model.safetensors": (change.changed_bytes,)}
    return [
        _one("onnx", "net.onnx", network, (change.changed_bytes,), onnx.read_inputs),
        Target("checkpoint", kept, ways, read_model),
    ]


def _character(made: _Made) -> Target:
    scene = {
        "asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 4}],
        "images": [{"uri": "data:image/png;base64,AAAA"}, {"uri": "b%20c.png"}],
        "nodes": [{"name": "Hips", "children": []}],
    }  # fmt: skip
    text = json.dumps(scene).encode()
    head = b"glTF" + np.array([2, 20 + len(text), len(text)], "<u4").tobytes() + b"JSON"
    files = {"a.glb": head + text, "a.gltf": text, "a.bin": bytes(4), "b c.png": b"x"}
    ways = {"a.glb": (change.changed_glb, change.changed_bytes), "a.gltf": change.JSON}

    def read(folder: Path) -> None:
        for name in ways:
            for path in linked_files(folder / name).values():
                path.read_bytes()

    return Target("gltf", files, ways, read)


def _texts(made: _Made) -> list[Target]:
    person = {"pose_keypoints_2d": list(np.linspace(1, 9, 75))}
    keypoints = json.dumps({"version": 1.3, "people": [person]}).encode()
    row = {"pose": [0.1] * 72, "shape": [0.0] * 10, "trans": [[1.0, 2.0, 3.0]]}
    takes = json.dumps({"2": {"1": {str(n): row for n in range(3)}}}).encode()
    camera = {"R": np.eye(3).tolist(), "t": [1.0, 2.0, 3.0], "f": [900.0, 900.0], "c": [5.0, 5.0]}
    cameras = json.dumps({"1": camera}).encode()
    return [
        _one(
            "openpose",
            "a_000000000001_keypoints.json",
            keypoints,
            change.JSON,
            openpose.read_people,
        ),
        _one("human36m", "a.json", takes, change.JSON, human36m.read_takes),
        _one("human36m_cameras", "a.json", cameras, change.JSON, human36m.read_cameras),
    ]
