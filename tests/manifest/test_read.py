"""Reading: the format's errors name line and field, and hostile YAML does nothing."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from gmrdata.manifest.read import load_clips, read_manifest
from gmrdata.stage.recipes import published_manifest
from gmrdata.values import limits
from gmrdata.values.clip import load_clip, save_clip
from gmrdata.values.errors import BadManifest

HEAD = """\
format: gmrdata/1
name: a
version: 1.0.0
description: d
licence: CC0-1.0
created_by:
  gmrdata: 0.1.0
kind: synthetic
"""


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refused(path: Path, *words: str) -> str:
    with pytest.raises(BadManifest) as caught:
        read_manifest(path)
    message = str(caught.value)
    for word in (str(path), *words):
        assert word in message
    return message


def test_unknown_key_with_line_field_and_clip(edit):
    path = edit(lambda data: data["clips"][1].update(licences="typing mistake"))
    message = refused(path)
    line = 1 + path.read_text().splitlines().index("  licences: typing mistake")
    assert message.startswith(f"{path}:{line}: clips[1] (clip walk).licences: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fps_hz": 0}, "fps_hz: Input should be greater than 0"),
        ({"fps_hz": "10"}, "fps_hz: Input should be a valid number"),
        ({"n_frames": 6.0}, "n_frames: Input should be a valid integer"),
        ({"licence": ""}, "licence: String should have at least 1 character"),
        ({"camera_motion": "pannning"}, "camera_motion: Input should be 'static', 'small'"),
        ({"id": "../walk"}, "id: String should match pattern"),
        ({"kept": [{"start": 0, "stop": 4}]}, "row 2 is in two of the kept and dropped ranges"),
        ({"kept": [{"start": 3, "stop": 6}]}, "rows 0..1 are neither kept nor dropped"),
        ({"kept": [{"start": 0, "stop": 2}]}, "ranges end at 3, but n_frames is 6"),
        ({"kept": [{"start": 0, "stop": 2}, {"start": 3, "stop": 7}]}, "end at 7, but n_frames"),
        ({"kept": [{"start": 3, "stop": 6}, {"start": 0, "stop": 2}]}, "not in ascending order"),
        ({"kept": [{"start": 2, "stop": 2}]}, "range 2..2 is empty"),
        ({"dropped": [{"start": 2, "stop": 3}]}, "dropped[0].reason: Field required"),
        ({"quality": {"scale": True}}, "quality.scale: Input should be a valid number"),
        ({"quality": {"registered_share": 1.5}}, "quality.registered_share: Input should be less"),
    ],
)
def test_broken_field(edit, change, said):
    refused(edit(lambda data: data["clips"][1].update(change)), "clips[1] (clip ", said)


@pytest.mark.parametrize(
    ("path_text", "said"),
    [
        ("../walk.npz", "climbs out with '..'"),
        ("clips/../../walk.npz", "climbs out with '..'"),
        ("/etc/hosts", "is absolute"),
        ("C:/walk.npz", "is absolute"),
        ("clips\\walk.npz", "backslash"),
        ("clips//walk.npz", "short form"),
        ("./clips/walk.npz", "short form"),
        ("clips/walk\n.npz", "control character"),
        ("", "at least 1 character"),
    ],
)
def test_unsafe_path(edit, path_text, said):
    path = edit(lambda data: data["clips"][1]["arrays"].update(path=path_text))
    refused(path, "clips[1] (clip walk).arrays.path", said)


def test_repeated_id(edit):
    path = edit(lambda data: data["clips"][1].update(id="bare"))
    refused(path, "these are repeated: bare")


def test_several_problems_come_at_once(edit):
    def change(data: dict) -> None:
        data["version"] = "1"
        data["clips"][0]["fps_hz"] = -1
        data["clips"][1]["fps_hz"] = -1

    refused(edit(change), "3 problems", "(clip bare).fps_hz", "(clip walk).fps_hz")


def test_format_of_the_future(edit):
    path = edit(lambda data: data.update(format="gmrdata/2", new_field=1))
    refused(path, "format is 'gmrdata/2', but gmrdata", "reads gmrdata/1")


NO_FORMAT = [
    (text, "no top key 'format'") for text in ("", "a\n", "- a\n", "kind: list\n", "null\n")
]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        *NO_FORMAT,
        (HEAD + "clips: [&a x, *a]\n", ":9: YAML anchors and aliases"),
        (HEAD + "clips: []\nname: b\n", ":10: key 'name' stands twice"),
        (HEAD + "clips: " + "[" * 40 + "]" * 40 + "\n", ":9: nested more than 32 levels"),
        (HEAD + "clips: !!python/object/apply:os.system ['true']\n", ":9: not plain YAML"),
        (HEAD + "clips: !!binary aGVsbG8=\n", "a tag of no plain data"),
        (HEAD + "clips: {? [a] : b}\n", ":9: a key must be plain text"),
        (HEAD + "clips: []\n<<: {a: b}\n", ":10: a key must be plain text"),
        (HEAD + "clips: [.nan]\n", "holds .nan"),
        (HEAD + f"clips: [0x{'f' * 5000}]\n", "Input should be an object"),
        (HEAD + f"clips: [{'9' * 5000}]\n", "not plain YAML"),
        (HEAD + 'clips: ["\\ud800"]\n', "m.yaml"),
        (HEAD + "clips: [a\n", "not plain YAML"),
        (HEAD + "clips: []\n---\nformat: gmrdata/1\n", "not plain YAML"),
        (HEAD.encode() + b"clips: [\xff]\n", "not UTF-8"),
        (HEAD + "clips: 5\n", ":9: clips: Input should be a valid"),
        (HEAD.replace("synthetic", "real") + "clips: []\n", "m.yaml: kind is 'real'; write what"),
        (HEAD.replace("kind: synthetic", "clips: []"), "m.yaml: has no top key 'kind'; write what"),
    ],
)
def test_hostile_yaml(tmp_path, text, said):
    refused(written(tmp_path, text), said)


def test_yaml_bomb_is_refused_before_it_grows(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    refused(written(tmp_path, HEAD + "\n".join(lines)), "anchors and aliases")


def test_oversized_file_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MOST_MANIFEST_BYTES", 100)
    refused(written(tmp_path, HEAD), "more than a manifest's 100")


def test_dates_and_names_of_trials_stay_text(tmp_path):
    """YAML 1.1 reads 02_03 as the octal number 131."""
    assert yaml.safe_load("02_03") == 131
    text = HEAD.replace("name: a", "name: 02_03").replace(
        "description: d", "description: 2021-12-01"
    )
    manifest = read_manifest(written(tmp_path, text + "clips: []\n"))
    assert (manifest.name, manifest.description) == ("02_03", "2021-12-01")


def test_clips_that_are_not_as_the_manifest_says_are_not_loaded(edit):
    """A corrected rate was ignored without a word, and the file's was taken."""

    def change(data: dict) -> None:
        data["clips"][1] |= {"fps_hz": 25.0, "body": "giant"}

    path = edit(change)
    with pytest.raises(BadManifest) as caught:
        load_clips(path)
    assert f"{path}: clip walk: fps_hz: is 25.0, but the file has 10.0; write" in str(caught.value)
    assert f"{path}: clip walk: body: is giant, but the file has " in str(caught.value)


def test_lists_have_no_clips_to_load():
    with pytest.raises(BadManifest, match="only lists clips"):
        load_clips(published_manifest("paper_table7"))


def test_paths_may_be_text(data_set):
    path = str(data_set / "set.yaml")
    assert read_manifest(path).name == "set" and [clip.id for clip in load_clips(path)] == [
        clip.id for clip in load_clips(data_set / "set.yaml")
    ]
    clip = load_clip(str(data_set / "clips" / "walk.npz"))
    save_clip(str(data_set / "again.npz"), clip, np.zeros(3))
    assert load_clip(str(data_set / "again.npz")).id == clip.id == "walk"
