"""A rigged character that is filmed in place of the body: what a recipe may say of it."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from gmrdata.character_file import linked_files
from gmrdata.config import Config


class Character(Config):
    """A skinned character whose bones are driven by the 24 joints.

    The truth that is stored stays the motion on the body's tree.  How far the character's own
    joints are from it is measured and stored: `gmrdata.character_record`.
    """

    path: Path
    """A .glb, .gltf or .fbx file with one skeleton; any unit, standing along the axes in a T-pose
    or an A-pose.  An FBX file must hold its pictures itself.  Surfaces become matt, and a
    half transparent one is there or not."""
    joint_map: dict[str, str] | None = None
    """`{bone: SMPL joint}`; None: by the bones' names, where they are Mixamo's, SMPL's, CMU's,
    Unreal's or Rigify's."""
    scale: Literal["legs", "keep"] = "legs"
    """`legs`: made as large as gives its legs (hip, knee, ankle) the length of the body's; `keep`:
    the file's size.  Then its feet slide by as much as its legs differ from the body's."""
    licence: str = Field(default="not stated", min_length=1)
    """Terms under which pictures of it may be passed on, for the manifest."""

    @property
    def inputs(self) -> dict[str, Path]:
        """Files that the pictures depend on, by name.

        Raises:
            MissingInput: a file is not there.
            BadCharacter: the file is cut off, not of its kind, or names files outside its folder.
        """
        linked = linked_files(self.path)
        return {"character": self.path} | {f"character/{name}": linked[name] for name in linked}

    def with_full_paths(self) -> "Character":
        """The same character for a process that runs in another folder."""
        return self.model_copy(update={"path": self.path.resolve()})
