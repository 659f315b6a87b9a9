"""The paper's tables as manifests, and the files that travel with the package."""

from collections import Counter
from typing import get_args

import pytest

from gmrdata.film import programmes
from gmrdata.manifest.check import check_manifest
from gmrdata.manifest.current import ListedClip, ListManifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import manifest_text
from gmrdata.stage import recipes
from gmrdata.values.errors import MissingInput


def published(name: str) -> tuple[ListedClip, ...]:
    manifest = read_manifest(recipes.published_manifest(name))
    assert isinstance(manifest, ListManifest)
    return manifest.clips


@pytest.mark.parametrize("name", recipes.published_names())
def test_published_manifests_are_as_gmrdata_writes_them(name):
    path = recipes.published_manifest(name)
    check_manifest(path)
    assert path.read_bytes() == manifest_text(read_manifest(path)).encode()
    assert read_manifest(path).name == name


def test_table_7():
    rows = published("paper_table7")
    assert len(rows) == 17
    assert len({row.source.sequence for row in rows}) == 16
    classes = Counter(row.camera_motion for row in rows)
    assert classes == {"small": 9, "panning": 5, "linear": 2, "linear_panning": 1}
    twice = [row for row in rows if row.source.sequence == "downtown_windowShopping_00"]
    assert [(row.frames.start, row.frames.stop, row.camera_motion) for row in twice] == [
        (48, 328, "panning"),
        (972, 1543, "linear"),
    ]
    assert sum(row.frames.stop - row.frames.start for row in rows) == 9719
    assert {row.fps_hz for row in rows} == {30}


def test_table_8():
    rows = published("paper_table8")
    assert len(rows) == 50
    assert sum(row.frames.stop for row in rows) == 26942
    assert {row.frames.start for row in rows} == {0}
    classes = Counter(row.camera_motion for row in rows)
    assert classes == {"circular": 44, "panning": 4, "small": 1, "linear": 1}
    assert [row.id for row in rows if row.camera_motion == "panning"] == [
        "02_03",
        "08_02",
        "08_04",
        "08_05",
    ]
    assert [row.id for row in rows if row.fps_hz == 60] == ["77_14", "77_19", "77_31"]
    assert {row.fps_hz for row in rows} == {60, 120}
    assert len({row.id.split("_")[0] for row in rows}) == 17
    frames = {row.id: row.frames.stop for row in rows}
    assert (frames["77_19"], frames["105_03"], frames["143_28"]) == (600, 513, 643)


def test_every_programme_of_table_8_can_be_rendered():
    kinds = {
        member.model_fields["kind"].default
        for member in get_args(get_args(programmes.Programme)[0])
    }
    assert {row.programme for row in published("paper_table8")} <= kinds


def test_trials_are_long_enough(cmu_dir):
    """The first frames of a trial are taken, so it must have as many."""
    checked = 0
    for row in published("paper_table8"):
        path = cmu_dir / "bvh" / f"{row.id}.bvh"
        if path.is_file():
            checked += 1
            head = path.read_text().partition("Frames:")[2]
            n_frames = int(head.split()[0]) - 1  # the first is an added T-pose
            assert row.frames.stop <= n_frames, row.id
    assert checked == 4


def test_unknown_names_say_what_there_is():
    with pytest.raises(MissingInput, match=r"^table9: .* carries only: paper_table7, paper_table8"):
        recipes.published_manifest("table9")
    with pytest.raises(MissingInput, match="no such published manifest"):
        recipes.published_manifest("../../pyproject")
    with pytest.raises(MissingInput, match="nothing: no such recipe file"):
        recipes.recipe_path("nothing")


def test_resources_are_there():
    schema = recipes.schema_v1()
    assert schema.is_file()
    assert "gmrdata/1" in (schema.parents[1] / "FORMAT.md").read_text()
    for name in recipes.recipe_names():
        assert recipes.recipe_path(name).is_file()
