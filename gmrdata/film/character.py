"""How the filmed person looks: a usual adult with clothes, or a rigged character in its place.

A character is driven by rotations: each limb points where the body's limb points.  As its bones
have other lengths, and its joints lie elsewhere in its flesh, its joints are then at other places
than the body's, which the stored motion says.  The residual is that gap, joint by joint [m].  It is
no error of the motion; it is how much a picture of the character misleads a method that is scored
by joint places.  Directions of limbs show the error of the motion itself, which should be none.

Layout of .glb and .gltf: the glTF 2.0 specification, sections 3 and 4.4 (binary glTF).
"""

import struct
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
from pydantic import Field

from gmrdata.motion.rest_pose import LIMBS
from gmrdata.values import limits
from gmrdata.values.body import JOINT, JOINT_NAMES, PARENTS, PHENOTYPES, BodyModel
from gmrdata.values.clip import CharacterRecord
from gmrdata.values.errors import BadCharacter, MissingInput
from gmrdata.values.files import parse_json, require_file
from gmrdata.values.joint_names import REQUIRED, joints_by_name, mapped_joints
from gmrdata.values.records import Config
from gmrdata.values.transforms import angles_deg

JITTER = 0.1
"""Deviation by which a drawn person differs from the listed one, so that no two are the same."""
LARGEST_COEFFICIENT = 2.0  # of people of a body without a list of adults


class TextureConfig(Config):
    """A picture that the body wears, such as those of the SMPL literature."""

    image: Path
    """.png or .jpg."""
    uv: Path
    """Picture coordinates of the faces: an .obj, or an .npz with `vt` (N, 2) and `ft` (F, 3)."""


class PersonConfig(Config):
    """How the person looks."""

    seed: int | None = Field(default=None, ge=0, le=limits.LARGEST_SEED)
    """Chooses skin, hair and clothes; None: the scene's seed does."""
    texture: TextureConfig | None = None
    """A picture instead of painted skin and clothes."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name."""
        worn = self.texture
        return {} if worn is None else {"texture_image": worn.image, "texture_uv": worn.uv}


def sample_person(body: BodyModel, rng: np.random.Generator, spread: float = 1.0) -> np.ndarray:
    """Someone's (S,) shape coefficients; a spread of 0 gives the mean person, 1 all sorts.

    The default body's people are adults of Anny's distribution (`adult_shapes`), in which the six
    phenotypes go together as they do there: independent coefficients would give a strong man's
    shoulders to a tired woman's hips.  Other bodies get normal coefficients within two deviations.
    """
    if body.adult_shapes is None:
        shape = rng.normal(0.0, 1.0, body.n_shape).clip(-LARGEST_COEFFICIENT, LARGEST_COEFFICIENT)
    else:
        adult = body.adult_shapes[int(rng.integers(len(body.adult_shapes)))]
        shape = adult + rng.normal(0.0, JITTER, body.n_shape)
    return np.asarray(spread * shape, dtype=np.float64)


def phenotypes_of(body: BodyModel, shape: np.ndarray) -> dict[str, float] | None:
    """Phenotypes of the listed adult of the nearest shape; None for a body without a list."""
    if body.adult_shapes is None or body.adult_phenotypes is None:
        return None
    nearest = np.linalg.norm(body.adult_shapes - shape, axis=1).argmin()
    return dict(zip(PHENOTYPES, body.adult_phenotypes[nearest].tolist(), strict=True))


SUFFIXES = (".glb", ".gltf", ".fbx")
_GLB_HEADER = struct.Struct("<4sII")
_CHUNK_HEADER = struct.Struct("<I4s")
_FBX_STARTS = (b"Kaydara FBX Binary", b"; FBX")


def linked_files(path: Path) -> dict[str, Path]:
    """Buffers and pictures that a character's file names, by those names; all are in its folder.
    None for FBX, whose pictures must be inside the file."""
    require_file(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        what = "a character is a .glb, .gltf or .fbx file"
        raise BadCharacter(f"{path}: {what}; export it as one (.glb is best)")
    if suffix == ".fbx":
        with path.open("rb") as file:
            if not file.read(64).startswith(_FBX_STARTS):
                raise BadCharacter(f"{path}: not an FBX file; export the character again")
        return {}
    names = (name for name in _uris(_gltf_of(path)) if not _holds_data(name))
    return {name: _inside(path, name) for name in dict.fromkeys(names)}


def _gltf_of(path: Path) -> Any:
    """The JSON part of a .glb or .gltf file."""
    data = path.read_bytes()
    if path.suffix.lower() == ".glb":
        data = _json_chunk(path, data)
    try:
        scene = parse_json(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        said = f"its JSON part can't be read ({error}); export it again"
        raise BadCharacter(f"{path}: {said}") from None
    if not isinstance(scene, dict) or not isinstance(scene.get("asset"), dict):
        raise BadCharacter(f"{path}: not a glTF file; export the character again")
    return scene


def _json_chunk(path: Path, data: bytes) -> bytes:
    if len(data) < _GLB_HEADER.size + _CHUNK_HEADER.size or data[:4] != b"glTF":
        raise BadCharacter(f"{path}: not a binary glTF file; export the character again")
    _, version, length = _GLB_HEADER.unpack_from(data)
    if version != 2:
        raise BadCharacter(f"{path}: glTF {version}, and only glTF 2 is read; export it again")
    if length != len(data):
        what = f"has {len(data)} bytes and says {length}, so it is cut off or damaged"
        raise BadCharacter(f"{path}: {what}; copy or export it again")
    chunk_length, kind = _CHUNK_HEADER.unpack_from(data, _GLB_HEADER.size)
    start = _GLB_HEADER.size + _CHUNK_HEADER.size
    if kind != b"JSON" or start + chunk_length > len(data):
        raise BadCharacter(f"{path}: has no JSON part; export the character again")
    return data[start : start + chunk_length]


def _uris(value: Any) -> Iterator[str]:
    """Every text under a key `uri`, at any depth."""
    if isinstance(value, dict) and isinstance(value.get("uri"), str):
        yield value["uri"]
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _uris(item)


def _holds_data(uri: str) -> bool:
    """Whether a URI is its own data.  Blender takes other texts after `data:` for a file's name."""
    return uri.startswith("data:") and ";base64," in uri


def _inside(path: Path, name: str) -> Path:
    """The file that a URI names, links followed."""
    plain = unquote(name)
    outside = BadCharacter(
        f"{path}: names the file {name!r}, which is not in its folder; nothing was read from "
        "there. Put everything into one .glb"
    )
    bad_letters = any(ord(letter) < 32 or letter in "\\:" for letter in plain)
    if not plain or bad_letters or plain.startswith("/") or ".." in plain.split("/"):
        raise outside
    folder = path.resolve().parent
    try:
        target = (folder / plain).resolve()
        target.exists()
    except (OSError, RuntimeError):  # links that point at each other, a name that is too long
        raise outside from None
    if not target.is_relative_to(folder):
        raise outside
    if not target.exists():
        raise MissingInput(f"{path}: names the file {name!r}, which is not there")
    if not target.is_file():
        raise BadCharacter(f"{path}: names {name!r}, which is no file but a folder or a device")
    return target


class Character(Config):
    """A skinned character whose bones are driven by the 24 joints."""

    path: Path
    """A .glb, .gltf or .fbx file with one skeleton; any unit, standing along the axes in a T-pose
    or an A-pose.  An FBX file must hold its pictures itself.  Surfaces become matt, and a
    half transparent one is there or not."""
    joint_map: dict[str, str] | None = None
    """`{bone: SMPL joint}`; None: by the names of `joint_names`, Mixamo's and others'."""
    scale: Literal["legs", "keep"] = "legs"
    """`legs`: made as large as gives its legs (hip, knee, ankle) the length of the body's; `keep`:
    the file's size.  Then its feet slide by as much as its legs differ from the body's."""
    licence: str = Field(default="not stated", min_length=1)
    """Terms under which pictures of it may be passed on, for the manifest."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name; errors as of `linked_files`."""
        linked = linked_files(self.path)
        return {"character": self.path} | {f"character/{name}": linked[name] for name in linked}


def residual_figures(record: CharacterRecord) -> dict[str, float]:
    """The residual in three numbers for the manifest: two over all frames and all joints that have
    a bone, and the mean angle between the character's and the body's `LIMBS`."""
    residual_mm = 1000 * np.linalg.norm(record.residual_m, axis=-1)
    return {
        "character_residual_mm_mean": float(np.nanmean(residual_mm)),
        "character_residual_mm_max": float(np.nanmax(residual_mm)),
        "character_bone_direction_deg_mean": float(limb_angles_deg(record).mean()),
    }


def limb_angles_deg(record: CharacterRecord) -> np.ndarray:
    """(T, 8) angles between the character's limbs, in `LIMBS`' order, and the body's [deg]."""
    start, end = np.transpose(LIMBS)
    true_m = record.joints_world_m - record.residual_m
    a = record.joints_world_m[:, end] - record.joints_world_m[:, start]
    b = true_m[:, end] - true_m[:, start]
    return angles_deg(a, b)


def find_bones(
    names: Sequence[str], parents: Sequence[int], joint_map: Mapping[str, str] | None, path: Path
) -> dict[int, int]:
    """`{index of the SMPL joint: index of the bone}`: which bone drives with which joint.

    A namespace (`mixamorig:`), `DEF-`, capitals, and a number that a converter put behind each name
    (`mixamorig:Hips_01`) are overlooked, but not by a joint_map `{bone: SMPL joint}`.  The bones
    must hang together as the joints do, and those of `REQUIRED` must be there.
    """
    if joint_map is None:
        bone_of = joints_by_name(names, parents)
    else:
        bone_of = mapped_joints(names, joint_map, path, BadCharacter)
    if missing := [joint for joint in REQUIRED if joint not in bone_of]:
        raise BadCharacter(
            f"{path}: no bone is known to be {', '.join(missing)}. Give a joint_map "
            f"{{bone: joint}} in the recipe, such as joint_map: {{{names[0] if names else 'Hips'}: "
            f"pelvis, ...}}. Its bones are {', '.join(names)}. The joints are {', '.join(JOINT)}"
        )
    bones = {JOINT[joint]: bone for joint, bone in bone_of.items()}
    _check_tree(bones, names, parents, path)
    return dict(sorted(bones.items()))


def joint_of_bone(bones: Mapping[int, int], parents: Sequence[int]) -> list[int]:
    """The joint that each bone moves with: its own, of the nearest bone above, or the pelvis."""
    own = {bone: joint for joint, bone in bones.items()}
    return [own.get(_nearest(bone, parents, own), 0) for bone in range(len(parents))]


def _nearest(number: int, parents: Sequence[int], wanted: Container[int]) -> int:
    """A bone or joint, or the nearest one above it, that is wanted; -1 where none is."""
    while number >= 0 and number not in wanted:
        number = parents[number]
    return number


def _check_tree(
    bones: Mapping[int, int], names: Sequence[str], parents: Sequence[int], path: Path
) -> None:
    """See that each joint's bone hangs on the bone of the joint above."""
    own = {bone: joint for joint, bone in bones.items()}
    for joint, bone in bones.items():
        wanted = _nearest(PARENTS[joint], PARENTS, bones)
        above = _nearest(parents[bone], parents, own)
        if own.get(above, -1) != wanted:
            upper = names[bones[wanted]] if wanted >= 0 else "no other joint's bone"
            raise BadCharacter(
                f"{path}: the bone {names[bone]} of {JOINT_NAMES[joint]} hangs on "
                f"{names[above] if above >= 0 else 'no bone'}, not on {upper}; "
                "name other bones in the recipe's joint_map, or export the deforming skeleton"
            )
