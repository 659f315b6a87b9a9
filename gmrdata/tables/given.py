"""What a table is made from, as the command line gives it, and what a row of it lacks."""

from dataclasses import dataclass
from pathlib import Path

from gmrdata.tables.recipe import Row, Scale, TableRecipe


@dataclass(frozen=True)
class Given:
    """Files and people."""

    manifests: tuple[Path, ...]
    """Manifests to train on."""
    scored: Path | None = None
    """Manifest to score; None for the held-out subjects of the manifests to train on."""
    poses: Path | None = None
    """Folder with another network's <clip id>.npz (the paper: VIBE's)."""
    keypoints: Path | None = None
    """Folder with <clip id>/ of 2D keypoints."""
    features: Path | None = None
    """Folder with <clip id>.npz of image features, of clips to train on and to score."""
    videos: tuple[Path, ...] = ()
    """Manifests of videos that the non-sequential model is trained on."""
    held_out: tuple[int | str, ...] = ()
    """People to hold out in place of the recipe's."""
    body: Path | None = None
    """Body model of the clips; None for the default body."""

    def subjects(self, scale: Scale) -> tuple[int | str, ...]:
        """Who is not trained on; nobody is held out where a manifest to score is given."""
        if self.scored is not None:
            return self.held_out
        return self.held_out or scale.held_out_subjects


def lacking(recipe: TableRecipe, row: Row, scale: Scale, given: Given) -> list[str]:
    """What has to be given for a row and is not, in words."""
    owner = row if row.network is None else recipe.row(row.network)
    # Another network's poses are of filmed clips, not of those that are held out of the training.
    has_own_clips = row.method == "gmr" and row.poses == "true" and bool(given.subjects(scale))
    needs = {
        "motions to train on (--manifest)": owner.method == "gmr"
        and row.method == "gmr"
        and not given.manifests,
        "clips to score (--scored)": given.scored is None and not has_own_clips,
        "VIBE's poses as <clip id>.npz (--poses)": given.poses is None
        and (row.poses == "given" or row.method == "vibe_cam"),
        "2D keypoints of STAF or OpenPose as <clip id>/ (--keypoints)": given.keypoints is None
        and row.method == "vibe_cam",
        "videos with true motions to train on (--videos)": row.method == "joint"
        and not given.videos,
        "image features as <clip id>.npz (--features)": row.method == "joint"
        and given.features is None,
    }
    return [what for what, is_lacking in needs.items() if is_lacking]
