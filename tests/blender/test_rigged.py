"""Rigged characters in place of the body: made by the tests, rendered for real, and measured."""

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmrdata.film.character import Character, limb_angles_deg, residual_figures
from gmrdata.film.programmes import Static, camera_path
from gmrdata.film.render import RenderConfig
from gmrdata.film.render_outputs import read_instances
from gmrdata.film.render_set import render_set
from gmrdata.film.scene import SceneConfig
from gmrdata.film.set_plan import SyntheticRecipe
from gmrdata.manifest.check import check_manifest
from gmrdata.pages.sets import write_set_pages
from gmrdata.read.body_file import save_body
from gmrdata.values import joint_names
from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS, WORLD_FROM_REST, BodyModel
from gmrdata.values.camera import project
from gmrdata.values.clip import (
    CharacterRecord,
    camera_of,
    load_character,
    load_clip,
    load_joints,
    save_character,
)
from gmrdata.values.errors import BadManifest, RenderFailed
from gmrdata.values.files import sha256_of_file
from gmrdata.values.motion import Motion
from gmrdata.values.skinning import motion_joints_m, motion_vertices_m
from tests.blender.jobs import Job, facing_x, grown, in_blender, mask_of, overlap, save_job, shrunk
from tests.clip_manifests import clips_of
from tests.folders import bytes_of

pytestmark = pytest.mark.slow

WIDTH_PX, HEIGHT_PX, N_FRAMES = 160, 90, 3
LEGS = {f"{side}_{joint}": 1.1 for side in ("left", "right") for joint in ("hip", "knee")}
ARMS = {f"{side}_{joint}": 0.9 for side in ("left", "right") for joint in ("shoulder", "elbow")}
ARMS_DOWN_RAD, LEGS_APART_RAD = 0.8, 0.12
MIXAMO = {joint: name for name, joint in joint_names.MIXAMO.items()}
X, Y, Z = np.eye(3)


Film, Files = Callable[..., Path], dict[str, Path]


def mixamo_name(joint: str) -> str:
    return f"mixamorig:{MIXAMO[joint]}"


def rotation(axis: np.ndarray, angle_rad: float) -> np.ndarray:
    return Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis)).as_matrix()


def stand_in(
    body: BodyModel,
    factors: Mapping[str, float],
    *,
    a_pose: bool = True,
    unit_m: float = 1.0,
    rename: Callable[[str], str] = mixamo_name,
) -> dict[str, Any]:
    """The body's mesh on a rig of its own, with bones `factors` times as long, in an A-pose.

    What follows a joint grows with the joint's factor; soles stay as thick as they were.
    """
    rest_m = body.joints_template_m
    turns = np.tile(np.eye(3), (24, 1, 1))
    if a_pose:
        for side, sign in (("left", 1.0), ("right", -1.0)):
            for start, end, towards, angle_rad in (
                ("shoulder", "elbow", [0.0, -1.0, 0.0], ARMS_DOWN_RAD),
                ("elbow", "wrist", [0.0, -1.0, 0.0], ARMS_DOWN_RAD),
                ("hip", "knee", [sign, 0.0, 0.0], LEGS_APART_RAD),
                ("knee", "ankle", [sign, 0.0, 0.0], LEGS_APART_RAD),
            ):
                bone = rest_m[JOINT[f"{side}_{end}"]] - rest_m[JOINT[f"{side}_{start}"]]
                axis = np.cross(bone, towards)
                turns[JOINT[f"{side}_{start}"]] = rotation(axis, angle_rad)
            for part in ("wrist", "hand"):
                turns[JOINT[f"{side}_{part}"]] = turns[JOINT[f"{side}_elbow"]]
    joints_m = np.array(rest_m)
    maps = [factors.get(name, 1.0) * turns[JOINT[name]] for name in JOINT_NAMES]
    for joint in range(1, 24):
        bone = rest_m[joint] - rest_m[PARENTS[joint]]
        joints_m[joint] = joints_m[PARENTS[joint]] + maps[PARENTS[joint]] @ bone
    vertices_m = sum(
        body.skin_weights[:, j, None] * ((body.template_m - rest_m[j]) @ maps[j].T + joints_m[j])
        for j in range(24)
    )
    return {
        "vertices_m": vertices_m @ WORLD_FROM_REST.T,
        "joints_m": joints_m @ WORLD_FROM_REST.T,
        "faces": body.faces,
        "weights": body.skin_weights,
        "names": np.array([rename(name) for name in JOINT_NAMES]),
        "parents": np.array(PARENTS),
        "unit_m": unit_m,
        "embed": True,
        "holes": False,
    }


@pytest.fixture(scope="module")
def characters(small_body, folder) -> Files:
    """The files of all characters, written with Blender in one process of its own."""
    t_pose = stand_in(small_body, {}, a_pose=False, rename=smpl_name)
    in_cm = stand_in(small_body, LEGS | ARMS, unit_m=0.01)
    cases = {
        "proportions.glb": in_cm,  # a Mixamo rig, in an A-pose, with longer legs and shorter arms
        "someone.fbx": in_cm,
        "twin.glb": t_pose,
        "holes.glb": t_pose | {"holes": True},
        "loose/loose.fbx": stand_in(small_body, {}) | {"embed": False},
    }
    paths = {Path(name).stem: folder / name for name in cases}
    for path, case in zip(paths.values(), cases.values(), strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path.with_suffix(".npz"), **case)
    script = Path(__file__).with_name("character_by_blender.py")
    in_blender(script, *paths.values())
    return paths


def striding(body: BodyModel) -> Motion:
    """Facing +x, in strides with bent knees, arms swinging and elbows bent."""
    local = np.tile(np.eye(3), (N_FRAMES, 23, 1, 1))
    for row in range(N_FRAMES):
        swing = 0.6 * np.cos(0.9 * row)
        for side, sign in (("left", 1), ("right", -1)):
            turns = {
                "shoulder": rotation(X, sign * swing) @ rotation(Z, -1.2 * sign),
                "elbow": rotation(Y, -0.7 * sign),
                "hip": rotation(X, -sign * swing),
                "knee": rotation(X, 0.3 + 0.2 * sign),
            }
            for part, turn in turns.items():
                local[row, JOINT[f"{side}_{part}"] - 1] = turn
    return facing_x(body, [[0.2 * row, 0.0, 0.93] for row in range(N_FRAMES)], local)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("rigged")


@pytest.fixture(scope="module")
def clip_path(small_body, folder) -> Path:
    motion, rng = striding(small_body), np.random.default_rng(2)
    programme = Static(azimuth_deg=90.0)
    camera = camera_path(programme, motion.pelvis_m, 10.0, WIDTH_PX, HEIGHT_PX, 60.0, rng)
    return save_job(folder, small_body, motion, camera).clip_path


@pytest.fixture(scope="module")
def film(box_place) -> Callable[..., Path]:
    """Films a clip of `clip_path`, with the body beside it, before a few boxes unless told."""

    def run(clip_path: Path, out_dir: Path, character: Character | None, **more: Any) -> Path:
        said = {"scene": box_place} | more
        config = RenderConfig(samples=1, character=character, **said)
        return Job(clip_path, clip_path.with_name("body.npz")).render(out_dir, config)

    return run


@pytest.fixture(scope="module")
def rendered(film, characters, clip_path, folder) -> Path:
    """In a place of our own, whose light is in the materials."""
    character = Character(path=characters["proportions"])
    return film(clip_path, folder / "rendered", character, joints=True, scene=SceneConfig())


def expected_joints_m(body: BodyModel, motion: Motion, keep: bool) -> np.ndarray:
    """Joints of the stand-in by the proportions alone: the body's bones, each times its factor."""
    true_m = motion_joints_m(body, motion)
    factors = LEGS | ARMS
    joints_m = np.array(true_m)
    for joint in range(1, 24):
        factor = factors.get(JOINT_NAMES[PARENTS[joint]], 1.0)
        bone_m = true_m[:, joint] - true_m[:, PARENTS[joint]]
        joints_m[:, joint] = joints_m[:, PARENTS[joint]] + factor * bone_m
    hips = [JOINT["left_hip"], JOINT["right_hip"]]
    scale = 1.0 if keep else 1 / 1.1
    middle_m = true_m[:, hips].mean(axis=1)
    ankle = JOINT["left_ankle"]
    ankle_m = body.joints_template_m[ankle, 1] - body.template_m[:, 1].min()
    above_m = middle_m[:, 2] - ankle_m
    middle_m[:, 2] = scale * (1.1 * above_m + ankle_m)
    own_m = joints_m[:, hips].mean(axis=1)
    return np.asarray(scale * (joints_m - own_m[:, None]) + middle_m[:, None])


def check_residual(record: CharacterRecord, body: BodyModel, clip_path: Path, keep: bool) -> None:
    motion = load_clip(clip_path).motion
    expected_m = expected_joints_m(body, motion, keep)
    np.testing.assert_allclose(record.joints_world_m, expected_m, atol=2e-5)
    true_m = motion_joints_m(body, motion)
    np.testing.assert_allclose(record.residual_m, expected_m - true_m, atol=2e-5)
    assert limb_angles_deg(record).max() < 0.01


def test_the_residual_is_what_the_proportions_imply(rendered, small_body, clip_path):
    record = load_character(rendered / "character.npz")
    check_residual(record, small_body, clip_path, keep=False)
    assert record.scale == pytest.approx(1 / 1.1, rel=1e-5)
    assert record.bones[JOINT["left_knee"]] == "mixamorig:LeftLeg"
    assert record.in_frame.all()
    figures = residual_figures(record)
    lengths_mm = 1000 * np.linalg.norm(record.residual_m, axis=-1)
    assert figures["character_residual_mm_mean"] == pytest.approx(lengths_mm.mean())
    assert figures["character_residual_mm_max"] == pytest.approx(lengths_mm.max())
    assert figures["character_residual_mm_mean"] > 20  # other proportions are far off
    assert figures["character_bone_direction_deg_mean"] < 0.01


def test_a_file_in_centimetres_keeps_its_size_if_told_to(
    film, characters, small_body, clip_path, folder
):
    character = Character(path=characters["someone"], scale="keep")
    kept = film(clip_path, folder / "kept", character)
    record = load_character(kept / "character.npz")
    check_residual(record, small_body, clip_path, keep=True)
    assert record.scale == 1.0


def test_the_picture_shows_the_character_where_its_joints_are(rendered):
    record, clip = load_character(rendered / "character.npz"), load_clip(rendered / "clip.npz")
    camera = camera_of(clip)
    joints_px = project(camera.world_from_cam, record.joints_world_m, camera.intrinsics_px)
    for row in range(N_FRAMES):
        mask = mask_of(rendered, row)
        assert mask.sum() > 150
        x_px, y_px = np.floor(joints_px[row]).astype(int).T
        assert grown(mask, 3)[y_px, x_px].all()  # joints are inside the flesh
        ys, xs = np.nonzero(mask)
        for pixels, joints in ((xs, joints_px[row, :, 0]), (ys, joints_px[row, :, 1])):
            assert pixels.min() > joints.min() - 8 and pixels.max() < joints.max() + 8


def test_it_has_its_own_picture_on_and_is_lit(rendered):
    frame = cv2.imread(str(rendered / "frames/00000.jpg")).astype(int)
    blue, _, red = frame[mask_of(rendered, 0)].T
    assert (blue - red > 60).mean() > 0.2 and (red > 120).mean() > 0.2


def smpl_name(joint: str) -> str:
    return "m_avg_" + joint.title().replace("Left_", "L_").replace("Right_", "R_")


@pytest.fixture(scope="module")
def twin(film, characters, clip_path, folder) -> Path:
    """The body itself as a character, in the T-pose with SMPL's names, with flow and depth."""
    character = Character(path=characters["twin"])
    return film(clip_path, folder / "twin", character, blend=True, flow=True, joints=True)


def test_the_body_as_a_character_is_the_body(film, twin, small_body, clip_path, folder):
    record = load_character(twin / "character.npz")
    assert np.abs(record.residual_m).max() < 1e-5 and record.scale == pytest.approx(1.0, rel=1e-5)
    cache = (twin / "scene/person.pc2").read_bytes()
    (n_vertices,) = struct.unpack_from("<i", cache, 16)
    found_m = np.frombuffer(cache, "<f4", offset=32).reshape(N_FRAMES + 2, n_vertices, 3)[1:-1]
    true_m = motion_vertices_m(small_body, load_clip(clip_path).motion)
    apart_m = cKDTree(found_m[1]).query(true_m[1])[0]
    assert apart_m.max() < 1e-4
    plain = film(clip_path, folder / "plain", None, flow=True, joints=True)
    for row in range(N_FRAMES):
        assert overlap(mask_of(twin, row), mask_of(plain, row)) > 0.98
    ours, flow = (cv2.imread(str(f / "flow/00000.png"), -1).astype(int) for f in (plain, twin))
    assert np.median(np.abs(ours - flow)[shrunk(mask_of(twin, 0), 3)]) <= 1  # 1/64 px
    seen, expected = (load_joints(f / "joints.npz").visible for f in (twin, plain))
    np.testing.assert_array_equal(seen, expected)
    assert not seen.all() and seen[:, JOINT["head"]].all()  # the camera is on the left
    assert not (plain / "character.npz").exists()


def test_there_is_nothing_in_the_holes_of_a_picture(film, characters, twin, clip_path, folder):
    character = Character(path=characters["holes"])
    holes = film(clip_path, folder / "holes", character, flow=True, instances=True)
    mask, whole = mask_of(holes, 0), mask_of(twin, 0)
    instances = read_instances(holes / "instances/00000.png")
    assert set(np.unique(instances)) == {0, 1}
    assert overlap(instances == 1, mask) > 0.9
    assert not (mask & ~whole).any()
    assert 0.3 < mask.sum() / whole.sum() < 0.8
    flow, expected = (cv2.imread(str(f / "flow/00000.png"), -1).astype(int) for f in (holes, twin))
    # Through a hole it is the farther surface's, which moves alike, and not the sum of both.
    apart_px = np.abs(flow - expected)[mask].max(axis=-1) / 64
    assert np.percentile(apart_px, 95) < 0.5 and apart_px.max() < 2.0


def of_two_materials(character: Path, path: Path, second: Mapping[str, Any]) -> Path:
    """The same character, the second half of whose faces has another material."""
    scene, binary = read_glb(character)
    (first,) = scene["meshes"][0]["primitives"]
    indices = scene["accessors"][first["indices"]]
    n_first = indices["count"] // 6 * 3
    bytes_each = {5123: 2, 5125: 4}[indices["componentType"]]
    rest = {"count": indices["count"] - n_first, "byteOffset": n_first * bytes_each}
    scene["accessors"].append(indices | rest)
    indices["count"] = n_first
    scene["materials"].append(second)
    other = {"indices": len(scene["accessors"]) - 1, "material": len(scene["materials"]) - 1}
    scene["meshes"][0]["primitives"] = [first, first | other]
    return write_glb(path, scene, binary)


def test_a_part_that_is_clear_all_over_is_not_there(film, characters, twin, clip_path, folder):
    """A visor, a cornea: a file gives such a part one opacity, and no picture of it."""
    masks = []
    for opacity in (0.8, 0.2):
        paint = {"baseColorFactor": [0.1, 0.6, 0.2, opacity]}
        material = {"name": "visor", "alphaMode": "BLEND", "pbrMetallicRoughness": paint}
        path = of_two_materials(characters["twin"], folder / f"visor_{opacity}.glb", material)
        out_dir = film(clip_path, folder / path.stem, Character(path=path), instances=True)
        masks.append(mask_of(out_dir, 0))
        instances = read_instances(out_dir / "instances/00000.png")
        assert overlap(instances == 1, masks[-1]) > 0.9
    dense, clear = masks
    np.testing.assert_array_equal(dense, mask_of(twin, 0))
    assert not (clear & ~dense).any() and 0.2 < clear.sum() / dense.sum() < 0.9


def test_a_character_of_which_nothing_can_be_seen_is_refused(film, characters, clip_path, folder):
    scene, binary = read_glb(characters["twin"])
    paint = {"baseColorFactor": [0.1, 0.6, 0.2, 0.2]}
    scene["materials"][0] |= {"alphaMode": "BLEND", "pbrMetallicRoughness": paint}
    character = Character(path=write_glb(folder / "clear.glb", scene, binary))
    with pytest.raises(RenderFailed, match=r"clear\.glb: nothing of it can be seen, as all its"):
        film(clip_path, folder / "clear", character)


def test_feet_stand_on_the_floor_where_the_bodys_do(
    film, clip_path, small_body, characters, folder
):
    soles_m = (small_body.template_m - small_body.joints_template_m[0])[:, 1].min()
    motion, camera = (
        facing_x(small_body, [[0, 0, -soles_m]] * N_FRAMES),
        load_clip(clip_path).camera,
    )
    (folder / "standing").mkdir()
    path = save_job(folder / "standing", small_body, motion, camera).clip_path
    for scale in ("legs", "keep"):
        character = Character.model_validate({"path": characters["proportions"], "scale": scale})
        out_dir = film(path, folder / f"standing/{scale}", character, blend=True)
        lowest_m = np.frombuffer((out_dir / "scene/person.pc2").read_bytes(), "<f4", offset=32)
        assert abs(lowest_m.reshape(-1, 3)[:, 2].min()) < 1e-3


def read_glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a .glb."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[20 + length + 8 :]


def write_glb(path: Path, scene: Mapping[str, Any], binary: bytes) -> Path:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(binary), len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary)
    return path


def test_another_run_from_a_gltf_with_files_beside_it_gives_the_same_bytes(
    film, rendered, characters, clip_path, folder
):
    scene, binary = read_glb(characters["proportions"])
    (folder / "parts").mkdir()
    view = scene["bufferViews"][scene["images"][0].pop("bufferView")]
    start = view.get("byteOffset", 0)
    (folder / "parts/stripes.png").write_bytes(binary[start : start + view["byteLength"]])
    scene["images"][0] = {"uri": "stripes.png", "name": "stripes"}
    scene["buffers"][0]["uri"] = "parts%20of%20it.bin"
    (folder / "parts/parts of it.bin").write_bytes(binary)
    path = folder / "parts/someone.gltf"
    path.write_text(json.dumps(scene))
    said = {"character": Character(path=path), "joints": True, "scene": SceneConfig()}
    out_dir = film(clip_path, folder / "from_parts", **said)
    assert bytes_of(out_dir) == bytes_of(rendered)
    written_ns = (out_dir / "stage.json").stat().st_mtime_ns
    film(clip_path, folder / "from_parts", **said)  # does nothing
    assert (out_dir / "stage.json").stat().st_mtime_ns == written_ns
    inputs = json.loads((out_dir / "stage.json").read_text())["inputs"]
    assert inputs["character/stripes.png"] == sha256_of_file(folder / "parts/stripes.png")


def test_a_missing_bone_is_named(film, characters, clip_path, folder):
    scene, binary = read_glb(characters["proportions"])
    for node in scene["nodes"]:
        node["name"] = node["name"].replace("LeftLeg", "Tentacle")
    path = write_glb(folder / "odd.glb", scene, binary)
    with pytest.raises(RenderFailed) as raised:
        film(clip_path, folder / "odd", Character(path=path))
    said = str(raised.value)
    assert said.startswith(f"{path}: no bone is known to be left_knee. Give a joint_map")
    assert "mixamorig:Tentacle" in said and "mixamorig:RightLeg" in said
    assert not (folder / "odd").exists()


def test_a_mesh_without_a_skeleton_is_no_character(film, characters, clip_path, folder):
    scene, binary = read_glb(characters["proportions"])
    del scene["skins"]
    for node in scene["nodes"]:
        node.pop("skin", None)
    path = write_glb(folder / "statue.glb", scene, binary)
    with pytest.raises(RenderFailed, match=r"statue\.glb: no skeleton moves a mesh of it"):
        film(clip_path, folder / "statue", Character(path=path))


def test_a_damaged_fbx_is_named(film, clip_path, folder):
    path = folder / "cut.fbx"
    path.write_bytes(b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", 7400) + b"\1" * 50)
    with pytest.raises(RenderFailed, match=r"cut\.fbx: Blender can't read this character"):
        film(clip_path, folder / "cut", Character(path=path))


def test_an_fbx_with_its_picture_elsewhere_is_refused(film, characters, clip_path, folder):
    path = characters["loose"]
    assert (folder / "loose/stripes.png").is_file()
    with pytest.raises(RenderFailed, match=r"loose\.fbx: its picture 'stripes.*' is not inside"):
        film(clip_path, folder / "loose/out", Character(path=path))


def test_a_set_has_a_character_in_one_clip_and_the_body_in_the_other(
    box_place, small_body, characters, folder
):
    save_body(folder / "small.npz", small_body)
    character = {"path": str(characters["proportions"]), "licence": "CC0-1.0"}
    clip = {"gait": "walk", "programme": {"kind": "static"}}
    recipe = SyntheticRecipe.model_validate(
        {
            "recipe": "synthetic",
            "name": "two",
            "body": str(folder / "small.npz"),
            "workers": 1,
            "clips": [{"id": "someone", "character": character, **clip}, {"id": "body", **clip}],
            "film": {"duration_s": 0.5, "fps_hz": 10, "width_px": 96, "height_px": 64},
            "render": {"samples": 1, "scene": box_place.model_dump()},
        }
    )
    path = render_set(recipe, folder / "set")
    check_manifest(path)
    body, someone = clips_of(path)  # sorted by id
    assert someone.quality is not None and body.quality is not None
    assert someone.character is not None and body.character is None
    assert someone.licence == "CC0-1.0; character: CC0-1.0" and body.licence == "CC0-1.0"
    record = load_character(path.parent / someone.character.path)
    expected = {"in_frame_share": 1.0} | residual_figures(record)
    assert {key: someone.quality.figures[key] for key in expected} == expected
    assert someone.quality.figures["character_residual_mm_mean"] > 20
    assert not any("character" in key for key in body.quality.figures)
    write_set_pages(recipe, folder / "set")
    page = (folder / "set" / "index.html").read_text()
    assert page.count("directions of limbs 0.00 degrees") == 1
    assert page.count("blend, its own light, seed 0") == 2  # and not sun
    record_path = path.parent / someone.character.path
    save_character(record_path, replace(record, in_frame=record.in_frame[1:]))
    with pytest.raises(BadManifest, match="clip someone: character: .*: no array 'joints_w"):
        check_manifest(path, hashes=False)
