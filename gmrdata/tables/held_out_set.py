"""A manifest of the clips that manifests' held-out subjects move in, to score.

out/clips/<clip id>.npz   copies of the clips, without images
out/manifest.yaml
"""

from collections.abc import Sequence
from pathlib import Path

from gmrdata.clip import read_npz
from gmrdata.errors import BadManifest, BadRecipe
from gmrdata.gmr.config import DataConfig
from gmrdata.gmr.split import split_manifests
from gmrdata.manifest.entry import clip_entry
from gmrdata.manifest.write import write_manifest
from gmrdata.paths import resolve_inside
from gmrdata.store import run_stage, write_npz


def held_out_set(
    manifest_paths: Sequence[Path], config: DataConfig, out_dir: Path, *, redo: bool = False
) -> Path:
    """Write the clips of the held-out subjects as a set of its own.

    Args:
        manifest_paths: The manifests.
        config: Who is held out.
        out_dir: Folder to make.
        redo: Throw away a set of other subjects or manifests.

    Returns:
        Path of `manifest.yaml`.

    Raises:
        BadRecipe: nobody is held out, or no clip is of a held-out subject.
        BadManifest: a manifest is broken, or two clips have one id.
    """
    if not config.held_out_subjects:
        raise BadRecipe("nothing to score: give --scored, or subjects to hold out with --held-out")

    def work(partial_dir: Path) -> None:
        files = split_manifests(manifest_paths, config).held_out
        ids = [file.entry.id for file in files]
        if len(set(ids)) < len(ids):
            twice = sorted({id for id in ids if ids.count(id) > 1})
            raise BadManifest(f"held-out clips of one id in two manifests: {', '.join(twice)}")
        entries = []
        for file in files:
            entry = file.entry
            arrays = read_npz(resolve_inside(file.manifest_path.parent, entry.arrays.path))
            path = resolve_inside(partial_dir, f"clips/{entry.id}.npz")
            # The arrays as they are: written anew, rotations would be rounded.
            write_npz(path, arrays | {"valid": file.load().valid})
            entries.append(
                clip_entry(
                    partial_dir,
                    clip_path=path,
                    id=entry.id,
                    camera_motion=entry.camera_motion,
                    licence=entry.licence,
                    source=entry.source,
                )
            )
        write_manifest(
            partial_dir / "manifest.yaml",
            name="held_out",
            version="1.0.0",
            description=f"Clips of {', '.join(map(str, config.held_out_subjects))}, to score.",
            kind="motions",
            licence="as stated by each clip",
            clips=entries,
        )

    inputs = {f"manifest_{i}": path for i, path in enumerate(manifest_paths)}
    return run_stage("held-out", out_dir, config, inputs, work, redo=redo) / "manifest.yaml"
