"""Writing: same content, same bytes; versions never change; entries come from stage folders."""

import hashlib
import json
import os
import subprocess
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.current import CreatedBy, ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import (
    ClipFiles,
    ManifestHead,
    clip_entry,
    made_by,
    recipe_sha256,
    stage_recipe,
    write_manifest,
)
from gmrdata.stage.store import run_stage
from gmrdata.threedpw.recipe import ThreedpwRecipe
from gmrdata.values import clip as clip_file
from gmrdata.values.errors import BadManifest, BadRecord, MissingInput
from gmrdata.values.records import Config
from tests.clip_manifests import a_walk

HEAD = [field.name for field in fields(ManifestHead)]


def rewritten(root: Path, path: Path, **changed: Any) -> Path:
    manifest = read_manifest(root / "set.yaml")
    assert not isinstance(manifest, ListManifest)
    said = {name: getattr(manifest, name) for name in type(manifest).model_fields}
    del said["format"]
    said |= changed
    return write_manifest(path, ManifestHead(**{name: said.pop(name) for name in HEAD}), **said)


def test_same_content_gives_the_same_bytes(data_set):
    path = data_set / "set.yaml"
    before, written_ns = path.read_bytes(), path.stat().st_mtime_ns
    clips = read_manifest(path).clips
    rewritten(data_set, path, clips=clips[::-1])
    assert path.read_bytes() == before
    assert path.stat().st_mtime_ns == written_ns  # left alone


def test_no_machine_path_and_no_time_in_the_bytes(data_set):
    by = made_by({"motions": "/home/someone/cmu", "list": ["/a/b"], "n": 1}, {"b": 2, "a": 1})
    text = rewritten(data_set, data_set / "other.yaml", created_by=by).read_text()
    assert "/home" not in text
    assert str(data_set) not in text
    assert by.recipe == {"motions": "cmu", "list": ["b"], "n": 1}
    assert list(by.seeds) == ["a", "b"]
    assert by.packages["numpy"] == np.__version__


@pytest.mark.parametrize("folder", ["/x/smpl/", "../smpl/", "~/smpl/", ""])
def test_a_recipe_says_the_same_however_its_files_are_written(folder):
    def made(folder: str) -> CreatedBy:
        sources = [{"kind": "folder", "path": f"{folder}masks"}]
        said = {"bodies": [f"{folder}F.npz", "anny"], "sequence": {"masks": {"sources": sources}}}
        return made_by(ThreedpwRecipe.model_validate({"recipe": "threedpw"} | said))

    found = made("smpl/")
    assert found.recipe["bodies"] == ["F.npz", "anny"] and "workers" not in found.recipe
    assert found == made(folder)


def test_a_version_never_changes(data_set):
    path = data_set / "set.yaml"
    before = path.read_bytes()
    with pytest.raises(BadManifest, match=r"set 1\.0\.0 is there with other content.*raise the"):
        rewritten(data_set, path, description="Other words.")
    assert path.read_bytes() == before
    rewritten(data_set, path, description="Other words.", version="1.0.1")
    assert read_manifest(path).version == "1.0.1"
    rewritten(data_set, path, description="Once more.", version="1.0.1", redo=True)
    assert read_manifest(path).description == "Once more."


def test_a_set_that_lacks_clips_says_so_and_replaces_no_complete_one(data_set, capsys):
    path, other = data_set / "set.yaml", data_set / "other.yaml"
    before, clips = path.read_bytes(), read_manifest(path).clips
    rewritten(data_set, path, clips=clips[:1], incomplete=True)
    assert path.read_bytes() == before
    assert "set 1.0.0 is there with all its clips, and stays" in capsys.readouterr().err
    for some in (clips[:1], clips[1:]):
        rewritten(data_set, other, clips=some, incomplete=True)
        found = read_manifest(other)
        assert (found.version, found.clips) == ("1.0.0-incomplete", some)
    rewritten(data_set, other)
    assert (read_manifest(other).version, read_manifest(other).clips) == ("1.0.0", clips)
    rewritten(data_set, other, version="1.1.0-rc.1", incomplete=True)
    assert read_manifest(other).version == "1.1.0-rc.1.incomplete"
    rewritten(data_set, path, clips=clips[:1], incomplete=True, redo=True)
    assert read_manifest(path).version == "1.0.0-incomplete"


def test_something_else_at_the_path_is_kept(data_set):
    path = data_set / "notes.yaml"
    path.write_text("- my notes\n")
    with pytest.raises(BadManifest, match="holds something that is no manifest"):
        rewritten(data_set, path)
    assert path.read_text() == "- my notes\n"


@pytest.mark.parametrize(
    "changed", [{"version": "1.0"}, {"kind": "real"}, {"name": ""}, {"kind": "list"}]
)
def test_broken_fields_write_nothing(data_set, changed):
    with pytest.raises(BadManifest, match=r"new\.yaml: can't be written"):
        rewritten(data_set, data_set / "new.yaml", **changed)
    assert not (data_set / "new.yaml").exists()


def test_entry_of_a_clip(data_set):
    walk = read_manifest(data_set / "set.yaml").clips[1]
    assert not hasattr(walk, "frames")
    assert [(part.start, part.stop) for part in walk.kept] == [(0, 2), (3, 6)]
    assert [(part.start, part.stop, part.reason) for part in walk.dropped] == [
        (2, 3, "no camera found")
    ]
    content = (data_set / "clips" / "walk.npz").read_bytes()
    assert walk.arrays.path == "clips/walk.npz"
    assert walk.arrays.size_bytes == len(content)
    assert walk.arrays.sha256 == hashlib.sha256(content).hexdigest()
    assert (walk.images.folder, walk.images.count) == ("frames", 6)
    assert walk.images.listing.path == "listings/frames.tsv"


def test_listing_is_checked_by_sha256sum(data_set):
    """The command that FORMAT.md gives."""
    command = "cut -f1,3 --output-delimiter='  ' ../listings/frames.tsv | sha256sum -c --quiet"
    subprocess.run(["bash", "-c", command], cwd=data_set / "frames", check=True)
    (data_set / "frames" / "00000.jpg").write_bytes(b"changed")
    done = subprocess.run(
        ["bash", "-c", command], cwd=data_set / "frames", check=False, capture_output=True
    )
    assert done.returncode != 0


def test_a_reason_per_row(data_set, walk_clip):
    path = data_set / "clips" / "walk.npz"
    valid = np.array([False, False, True, False, False, True])
    clip_file.save_clip(path, replace(walk_clip, valid=valid), np.zeros(3))
    reasons = ["drift", "drift", "", "drift", "no camera", ""]
    entry = clip_entry(data_set, ClipFiles(path), a_walk(dropped_reason=reasons))
    assert [(part.start, part.stop, part.reason) for part in entry.dropped] == [
        (0, 2, "drift"),
        (3, 4, "drift"),
        (4, 5, "no camera"),
    ]
    with pytest.raises(BadManifest, match="5 reasons for 6 frames"):
        clip_entry(data_set, ClipFiles(path), a_walk(dropped_reason=reasons[1:]))


def test_a_stages_record_is_no_part_of_its_folder(data_set):
    """It holds times, so two runs of one recipe would not give the same manifest."""
    before = (data_set / "set.yaml").read_bytes()
    (data_set / "masks" / "stage.json").write_text('{"seconds": 1.5}')
    check_manifest(data_set / "set.yaml")
    files = ClipFiles(data_set / "clips" / "walk.npz", masks=data_set / "masks")
    entry = clip_entry(data_set, files, a_walk())
    assert entry.masks == read_manifest(data_set / "set.yaml").clips[1].masks
    assert (data_set / "set.yaml").read_bytes() == before


def test_two_manifests_share_a_folder(data_set):
    """Found in use: listings named after the clip overwrote each other's masks."""
    other = data_set / "other_masks"
    (data_set / "masks").rename(other)
    (data_set / "masks").mkdir()
    for image in other.iterdir():
        (data_set / "masks" / image.name).write_bytes(image.read_bytes())
    for image in other.iterdir():
        image.write_bytes(b"another mask")
    files = ClipFiles(data_set / "clips" / "walk.npz", images=data_set / "frames", masks=other)
    entry = clip_entry(data_set, files, a_walk())
    rewritten(data_set, data_set / "second.yaml", name="second", clips=[entry])
    check_manifest(data_set / "set.yaml")
    check_manifest(data_set / "second.yaml")


def test_entry_with_another_id(data_set):
    with pytest.raises(BadManifest, match="holds clip walk, not run"):
        clip_entry(data_set, ClipFiles(data_set / "clips" / "walk.npz"), a_walk(id="run"))


def test_id_that_would_write_elsewhere(data_set, walk_clip):
    path = data_set / "clips" / "walk.npz"
    clip_file.save_clip(path, replace(walk_clip, id="../../walk"), np.zeros(3))
    with pytest.raises(BadManifest, match="can't be listed"):
        clip_entry(data_set, ClipFiles(path, images=data_set / "frames"), a_walk())


def test_file_outside_the_manifests_folder(data_set):
    with pytest.raises(BadManifest, match="write the manifest to a folder above"):
        clip_entry(data_set / "frames", ClipFiles(data_set / "clips" / "walk.npz"), a_walk())


@pytest.mark.parametrize("listed", ["masks", "video"])
def test_a_name_that_is_no_utf8(data_set, listed):
    """It ended with a traceback, of a folder once all was hashed."""
    folder = data_set / "masks" if listed == "masks" else data_set
    path = folder / os.fsdecode(b"donn\xe9e.png")
    path.write_bytes(b"x")
    files = ClipFiles(data_set / "clips" / "walk.npz", masks=folder)
    if listed == "video":
        files = ClipFiles(data_set / "clips" / "walk.npz", video=path)
    with pytest.raises(BadManifest, match=r"the bytes of .*donn.*xe9e.png are no UTF-8; rename"):
        clip_entry(data_set, files, a_walk())


@pytest.mark.parametrize("folder", ["empty", "absent"])
def test_no_images(data_set, folder):
    (data_set / "empty").mkdir()
    files = ClipFiles(data_set / "clips" / "walk.npz", images=data_set / folder)
    with pytest.raises(MissingInput, match=folder):
        clip_entry(data_set, files, a_walk())


class Blur(Config):
    radius_px: int = 3
    """Radius [px]."""
    cache: str = "/var/cache/blur"
    """A path of this machine."""


def test_recipe_of_a_stage(data_set, edit):
    frame = data_set / "frames" / "00000.jpg"

    def work(partial: Path) -> None:
        (partial / "x").write_bytes(b"x")

    out_dir = run_stage("blur", data_set / "blurred", Blur(), {"image": frame}, work)
    recipe = stage_recipe(out_dir)
    assert recipe.config == {"radius_px": 3, "cache": "blur"}
    assert recipe.inputs == {"image": hashlib.sha256(frame.read_bytes()).hexdigest()}
    content = {"stage": "blur", "config": recipe.config, "inputs": recipe.inputs}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    assert recipe.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert recipe.sha256 == recipe_sha256("blur", recipe.config, recipe.inputs)
    check_manifest(edit(lambda data: data["clips"][1].update(recipe=recipe.model_dump())))


def test_recipe_of_a_folder_that_no_stage_made(data_set):
    with pytest.raises(MissingInput, match=r"stage\.json"):
        stage_recipe(data_set)
    (data_set / "stage.json").write_text("{}")
    with pytest.raises(BadRecord, match=r"stage\.json: has no `format`"):
        stage_recipe(data_set)
