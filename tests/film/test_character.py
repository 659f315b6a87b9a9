"""What is said of a rigged character before Blender opens it: its file, its bones, its record."""

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gmrdata.cli.demo_recipe import DemoRecipe
from gmrdata.film.character import (
    Character,
    find_bones,
    joint_of_bone,
    limb_angles_deg,
    linked_files,
    residual_figures,
)
from gmrdata.film.set_plan import SyntheticRecipe, render_config
from gmrdata.values import joint_names
from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS
from gmrdata.values.clip import CharacterRecord, load_character, save_character
from gmrdata.values.errors import BadCharacter, BadMotionFile, GmrdataError, MissingInput
from gmrdata.values.records import with_absolute_paths

FILE = Path("someone.glb")
SCENE: dict[str, Any] = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4}]}


def glb(scene: object) -> bytes:
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


_NAME = {joint: name for name, joint in joint_names.MIXAMO.items()}
MIXAMO = tuple(_NAME[joint] for joint in JOINT_NAMES)
SMPL_FBX = (
    "Pelvis", "L_Hip", "R_Hip", "Spine1", "L_Knee", "R_Knee", "Spine2", "L_Ankle", "R_Ankle",
    "Spine3", "L_Foot", "R_Foot", "Neck", "L_Collar", "R_Collar", "Head", "L_Shoulder",
    "R_Shoulder", "L_Elbow", "R_Elbow", "L_Wrist", "R_Wrist", "L_Hand", "R_Hand",
)  # fmt: skip
UNREAL = (
    "pelvis", "thigh_l", "thigh_r", "spine_01", "calf_l", "calf_r", "spine_02", "foot_l", "foot_r",
    "spine_03", "ball_l", "ball_r", "neck_01", "clavicle_l", "clavicle_r", "head", "upperarm_l",
    "upperarm_r", "lowerarm_l", "lowerarm_r", "hand_l", "hand_r", "middle_01_l", "middle_01_r",
)  # fmt: skip
RIGIFY = (
    "spine", "thigh.L", "thigh.R", "spine.001", "shin.L", "shin.R", "spine.002", "foot.L", "foot.R",
    "spine.003", "toe.L", "toe.R", "spine.004", "shoulder.L", "shoulder.R", "spine.006",
    "upper_arm.L", "upper_arm.R", "forearm.L", "forearm.R", "hand.L", "hand.R", "f_middle.01.L",
    "f_middle.01.R",
)  # fmt: skip


@pytest.mark.parametrize(
    "names",
    [
        MIXAMO,
        [f"mixamorig:{name}" for name in MIXAMO],
        [f"mixamorig{name}" for name in MIXAMO],
        [f"mixamorig7:{name}" for name in MIXAMO],
        [f"mixamorig:{name}_{number:02d}" for number, name in enumerate(MIXAMO)],
        [f"{name}.001" for name in MIXAMO],
        JOINT_NAMES,
        [f"m_avg_{name}" for name in SMPL_FBX],
        UNREAL,
        RIGIFY,
        [f"DEF-{name}" for name in RIGIFY],
    ],
    ids=lambda names: names[1],
)
def test_known_names_are_found_in_any_order(names):
    expected = {joint: joint for joint in range(24)}
    assert find_bones(names, PARENTS, None, FILE) == expected
    order = np.random.default_rng(0).permutation(24)
    place = np.argsort(order)
    shuffled = [names[bone] for bone in order]
    parents = [place[PARENTS[bone]] if PARENTS[bone] >= 0 else -1 for bone in order]
    found = find_bones(shuffled, parents, None, FILE)
    assert {joint: order[bone] for joint, bone in found.items()} == expected


def test_cmus_names_lack_hands_and_its_hip_joints_are_passed_over():
    names = ["Hips", "LHipJoint", "LeftUpLeg", "LeftLeg", "LeftFoot", "RHipJoint", "RightUpLeg"]
    names += ["RightLeg", "RightFoot", "LowerBack", "Spine", "Spine1", "LeftShoulder", "LeftArm"]
    names += ["LeftForeArm", "LeftHand", "LeftFingerBase", "RightShoulder", "RightArm"]
    names += ["RightForeArm", "RightHand", "RightFingerBase"]
    parents = [-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 12, 13, 14, 15, 11, 17, 18, 19, 20]
    found = find_bones(names, parents, None, FILE)
    assert names[found[JOINT["spine1"]]] == "LowerBack"
    assert names[found[JOINT["left_wrist"]]] == "LeftFingerBase"
    assert JOINT["left_hand"] not in found and JOINT["neck"] not in found
    follows = joint_of_bone(found, parents)
    assert follows[names.index("LHipJoint")] == JOINT["pelvis"]
    assert follows[names.index("LeftHand")] == JOINT["left_elbow"]


def test_a_joint_map_names_bones_as_they_are():
    names = [f"bone {number}" for number in range(24)]
    joint_map = dict(zip(names, JOINT_NAMES, strict=True))
    assert find_bones(names, PARENTS, joint_map, FILE) == {joint: joint for joint in range(24)}
    partly = {name: joint for name, joint in joint_map.items() if joint != "left_knee"}
    for wrong, message in (
        (partly, "no bone is known to be left_knee. Give a joint_map"),
        (partly | {"tail": "left_knee"}, "the joint map names tail, which the file does not have"),
        (joint_map | {"bone 1": "thigh"}, "map speaks of thigh; SMPL's joints are pelvis"),
        (joint_map | {"bone 1": "head"}, "the joint map names head more than once"),
    ):
        with pytest.raises(BadCharacter, match=message):
            find_bones(names, PARENTS, wrong, FILE)
    with pytest.raises(BadCharacter, match="no bone is known to be pelvis"):
        find_bones(MIXAMO, PARENTS, {}, FILE)  # an empty map is no order to guess by names


def test_bones_that_hang_together_in_another_way_are_named():
    parents = list(PARENTS)
    parents[JOINT["left_knee"]] = -1  # an exported control rig
    with pytest.raises(BadCharacter, match="LeftLeg of left_knee hangs on no bone, not on LeftUp"):
        find_bones(MIXAMO, parents, None, FILE)


def test_nobody_has_no_bones():
    with pytest.raises(BadCharacter, match="no bone is known to be pelvis, left_hip"):
        find_bones([], [], None, FILE)


def test_a_files_own_files_are_inputs(tmp_path, monkeypatch):
    path = tmp_path / "someone.gltf"
    images = [{"uri": "skin%20one.png"}, {"uri": "data:image/png;base64,AAAA"}]
    path.write_text(json.dumps({**SCENE, "buffers": [{"uri": "a/b.bin"}], "images": images}))
    with pytest.raises(MissingInput, match=r"names the file 'a/b\.bin', which is not there"):
        linked_files(path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a/b.bin").write_bytes(b"1234")
    (tmp_path / "skin one.png").write_bytes(b"1234")
    assert linked_files(path) == {
        "a/b.bin": tmp_path / "a/b.bin",
        "skin%20one.png": tmp_path / "skin one.png",
    }
    monkeypatch.chdir(tmp_path)
    character = Character(path=Path("someone.gltf"))
    assert list(character.inputs) == ["character", "character/a/b.bin", "character/skin%20one.png"]
    assert with_absolute_paths(character).path == path


@pytest.mark.parametrize(
    "uri",
    ["../secret.png", "%2e%2e/secret.png", "/etc/passwd", "file:///etc/passwd", "a/../../b.png",
     "http://example.org/a.png", "c:\\\\a.png", "..\\\\secret.png", "link/secret.png", "a\\nb", "",
     "data:/../../secret.png"],
)  # fmt: skip
def test_files_outside_the_folder_are_refused(tmp_path, uri):
    (tmp_path / "secret.png").write_bytes(b"secret")
    (tmp_path / "own").mkdir()
    (tmp_path / "own/link").symlink_to(tmp_path)
    path = tmp_path / "own/someone.glb"
    path.write_bytes(glb({**SCENE, "images": [{"extras": [{"uri": uri}]}]}))
    with pytest.raises(BadCharacter, match=r"which is not in its folder; nothing was read"):
        linked_files(path)


def test_devices_and_pipes_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    (tmp_path / "folder.bin").mkdir()
    path = tmp_path / "someone.glb"
    for name in ("pipe.bin", "folder.bin"):
        path.write_bytes(glb({**SCENE, "buffers": [{"uri": name}]}))
        with pytest.raises(BadCharacter, match=f"names '{name}', which is no file"):
            linked_files(path)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.glb", glb(SCENE)[:-5], "so it is cut off or damaged"),
        ("a.glb", b"A person, in words.", "not a binary glTF file"),
        ("a.glb", b"A long description of a person, in words.", "not a binary glTF file"),
        ("a.glb", b"", "not a binary glTF file"),
        ("a.glb", glb(SCENE).replace(b"glTF\x02", b"glTF\x01"), "only glTF 2 is read"),
        ("a.glb", glb(SCENE).replace(b"JSON", b"BIN\0"), "has no JSON part"),
        ("a.glb", glb([1, 2]), "not a glTF file"),
        ("a.gltf", b"{", "its JSON part can't be read"),
        ("a.gltf", b"\xff\xfe", "its JSON part can't be read"),
        ("a.gltf", b"[" * 100_000, "its JSON part can't be read"),
        ("a.fbx", b"A person, in words.", "not an FBX file"),
        ("a.blend", b"BLENDER", r"a character is a \.glb, \.gltf or \.fbx file"),
    ],
)
def test_other_files_are_refused(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(BadCharacter, match=message):
        linked_files(tmp_path / name)


@given(st.integers(0, len(glb(SCENE)) - 1), st.integers(0, 255))
def test_a_damaged_byte_never_crashes(tmp_path_factory, place, byte):
    data = bytearray(glb(SCENE))
    data[place] = byte
    path = tmp_path_factory.getbasetemp() / "damaged.glb"
    path.write_bytes(data)
    try:
        assert linked_files(path) == {}
    except GmrdataError as error:
        assert str(path) in str(error)


def test_what_a_recipe_may_say():
    with pytest.raises(ValidationError, match="'legs' or 'keep'"):
        Character.model_validate({"path": "a.glb", "scale": 2})
    with pytest.raises(MissingInput, match="no such file"):
        _ = Character(path=Path("nobody.glb")).inputs


def test_the_demo_films_the_body_as_its_masks_are_drawn_from_it():
    clip = {"id": "a", "gait": "walk", "programme": {"kind": "static"}}
    recipe = {"recipe": "demo", "clips": [clip], "render": {"character": {"path": "a.glb"}}}
    with pytest.raises(ValidationError, match="use a synthetic recipe for rigged characters"):
        DemoRecipe.model_validate(recipe)


def test_a_clips_own_character_comes_before_the_sets():
    clip = {"gait": "walk", "programme": {"kind": "static"}}
    recipe = SyntheticRecipe.model_validate(
        {
            "recipe": "synthetic",
            "name": "two",
            "clips": [{"id": "a", **clip}, {"id": "b", "character": {"path": "b.glb"}, **clip}],
            "render": {"samples": 2, "character": {"path": "a.glb"}},
        }
    )
    first, second = (render_config(recipe, clip) for clip in recipe.clips)
    assert first.character is not None and first.character.path == Path("a.glb")
    assert second.character is not None and second.character.path == Path("b.glb")
    assert first.samples == second.samples == 2


@pytest.fixture
def record() -> CharacterRecord:
    """The true joints, all 3 cm up and 4 cm aside, without a bone for the hands."""
    true_m = np.random.default_rng(1).normal(size=(5, 24, 3))
    residual_m = np.tile([0.0, 0.04, 0.03], (5, 24, 1))
    residual_m[:, [JOINT["left_hand"], JOINT["right_hand"]]] = np.nan
    in_frame = np.array([True, True, False, True, True])
    return CharacterRecord(true_m + residual_m, residual_m, in_frame, (*MIXAMO[:-2], "", ""), 0.9)


def test_a_record_comes_back(record, tmp_path):
    save_character(tmp_path / "character.npz", record)
    back = load_character(tmp_path / "character.npz")
    np.testing.assert_array_equal(back.joints_world_m, record.joints_world_m)
    np.testing.assert_array_equal(back.residual_m, record.residual_m)
    np.testing.assert_array_equal(back.in_frame, record.in_frame)
    assert back.bones == record.bones and back.scale == 0.9
    np.savez(tmp_path / "other.npz", in_frame=record.in_frame)
    with pytest.raises(BadMotionFile, match=r"no array 'joints_world_m' of shape \(5, 24, 3\)"):
        load_character(tmp_path / "other.npz")


def test_figures(record):
    figures = residual_figures(record)
    assert figures["character_residual_mm_mean"] == pytest.approx(50)
    assert figures["character_residual_mm_max"] == pytest.approx(50)
    assert figures["character_bone_direction_deg_mean"] == pytest.approx(0, abs=1e-9)
    joints_m, residual_m = record.joints_world_m.copy(), record.residual_m.copy()
    hip, knee = JOINT["left_hip"], JOINT["left_knee"]
    thigh_m = joints_m[:, knee] - joints_m[:, hip]
    aside_m = np.cross(thigh_m, [0.3, 0.1, 0.2])
    aside_m *= np.linalg.norm(thigh_m, axis=1, keepdims=True) / np.linalg.norm(
        aside_m, axis=1, keepdims=True
    )
    moved_m = aside_m - thigh_m  # the thigh at a right angle to where it was
    joints_m[:, knee] += moved_m
    residual_m[:, knee] += moved_m
    turned = CharacterRecord(joints_m, residual_m, record.in_frame, record.bones, 0.9)
    np.testing.assert_allclose(limb_angles_deg(turned)[:, 0], 90)
