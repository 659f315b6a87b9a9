"""Long manifests, a line of JSON for each clip: the same as YAML, and YAML's library reads it."""

import re
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.manifest import yaml_text
from gmrdata.manifest.current import ClipEntry, CreatedBy, Manifest
from gmrdata.manifest.read import read_manifest
from gmrdata.manifest.write import ManifestHead, manifest_text, write_manifest
from gmrdata.values.errors import BadManifest

HEAD = ManifestHead(name="many", version="1.0.0", description="d", licence="l", kind="motions")
BY = CreatedBy(gmrdata="0.1.0")


def a_clip(number: int, licence: str = "CC0") -> ClipEntry:
    return ClipEntry.model_validate(
        {
            "id": f"c{number}", "licence": licence, "body": "anny", "fps_hz": 30.0, "n_frames": 2,
            "source": {"dataset": "CMU", "sequence": "06_04"}, "frame": "world",
            "translation_of": "smpl_transl", "camera_motion": "none",
            "kept": ({"start": 0, "stop": 2},),
            "arrays": {"path": f"clips/{number}.npz", "size_bytes": 1, "sha256": "0" * 64},
            "quality": {"figures": {"cpu": 1e-05, "large": 1e22, "small": -2.5e-07, "zero": 0.0}},
        }
    )  # fmt: skip


@pytest.fixture
def long_manifest(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(yaml_text, "LINES_FROM", 3)
    clips = [a_clip(0, '\x85\u2028 1e-05, "x\\'), a_clip(1, "née 𝄞\x7f"), a_clip(2)]
    return write_manifest(tmp_path / "many.yaml", HEAD, clips, BY)


def test_all_readers_find_the_same(long_manifest, monkeypatch):
    found = read_manifest(long_manifest)
    assert yaml_text.load_lines(long_manifest) is not None
    assert [clip.id for clip in found.clips] == ["c0", "c1", "c2"]
    plain = yaml.safe_load(long_manifest.read_text(encoding="utf-8"))
    assert plain["clips"] == [
        clip.model_dump(mode="json", exclude_defaults=True) for clip in found.clips
    ]
    monkeypatch.setattr(yaml_text, "load_lines", lambda _: None)
    assert read_manifest(long_manifest) == found
    monkeypatch.setattr(yaml_text, "LINES_FROM", 9)
    short = manifest_text(found)
    assert yaml.safe_load(short) == plain and "\n- id: c0\n" in short


def test_a_recipe_of_any_length_may_stand_before_the_clips(tmp_path, monkeypatch):
    """A set of some thousand rendered clips has its recipe there."""
    monkeypatch.setattr(yaml_text, "LINES_FROM", 3)
    recipe = {"clips": [{"id": "x" * 100, "number": number} for number in range(10_000)]}
    by = CreatedBy(gmrdata="0.1.0", recipe=recipe)
    path = write_manifest(tmp_path / "many.yaml", HEAD, [a_clip(n) for n in range(3)], by)
    head, _, clips = yaml_text.load_lines(path) or pytest.fail("read as plain YAML")
    assert head["created_by"]["recipe"] == recipe and len(clips) == 3


@given(
    st.dictionaries(
        st.text(max_size=5),
        st.recursive(
            st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text()
            | st.floats(allow_nan=False, allow_infinity=False),
            lambda inner: st.lists(inner, max_size=3)
            | st.dictionaries(st.text(max_size=3), inner, max_size=3),
            max_leaves=8,
        ),
    )
)  # fmt: skip
def test_a_line_is_yaml_too(clip):
    text = yaml_text.dump_lines({}, [clip]).partition("clips:")[2]
    assert yaml.safe_load(f"clips:{text}") == {"clips": [clip]}


@pytest.mark.parametrize(
    ("pattern", "text", "said"),
    [
        (r'"n_frames": 2', '"n_frames": 3', r":10: clips\[0\] \(clip c0\): kept and dropped"),
        (r'"fps_hz"', '"rate_hz"', r":10: clips\[0\] \(clip c0\)\.fps_hz: Field required"),
        (r'"fps_hz": 30.0', '"fps_hz": NaN', ":10: not a line of plain JSON: holds NaN"),
        # It was read as infinite, with which `check` ended in a traceback where a recipe has it.
        (r'"cpu": 1.0e-05', '"cpu": 1e999', ":10: not a line of plain JSON: holds 1e999; leave"),
        (r'"fps_hz": 30.0', '"fps_hz": "30.0"', ":10: .*fps_hz: Input should be a valid number"),
        (r'"body": "anny"', '"id": "d"', ":10: not a line of plain JSON: key 'id' stands twice"),
        (r"\}\}\n- ", "}}\n  ", ":11: a clip must be one line, as on the lines before"),
        (r'"c1"', '"c0"', r":9: clips: clip ids must be unique, but these are repeated: c0"),
        (r'\}\}\n- \{"id": "c1"', '}\n- {"id": "c1"', ":10: not a line of plain JSON: "),
        # The second was read alone, without a word.
        ("licence: l\n", "licence: l\nclips: []\n", ":6: key 'clips' stands twice; remove one"),
        (r"\}\}\n$", "}}, x: [&a 1, *a]\n", ":12: not a line of plain JSON: "),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_line(long_manifest, pattern, text, said):
    before = long_manifest.read_text(encoding="utf-8")
    after = re.sub(pattern, text, before, count=1)
    assert after != before
    long_manifest.write_text(after, encoding="utf-8")
    with pytest.raises(BadManifest, match=said):
        read_manifest(long_manifest)


def test_deep_nesting_and_size_are_limited(long_manifest, monkeypatch):
    before = long_manifest.read_text(encoding="utf-8")
    deep = '"quality": {"figures": {"cpu": ' + "[" * 100_000 + "]" * 100_000
    long_manifest.write_text(before.replace('"quality": {"figures": {"cpu": 1.0e-05', deep, 1))
    with pytest.raises(BadManifest, match=":10: not a line of plain JSON"):
        read_manifest(long_manifest)
    monkeypatch.setattr(yaml_text, "MAX_BYTES", 100)
    with pytest.raises(BadManifest, match="more than a manifest's 100; split the data set"):
        read_manifest(long_manifest)


def test_a_short_manifest_is_written_for_people(tmp_path):
    path = write_manifest(tmp_path / "few.yaml", HEAD, [a_clip(1)], BY)
    assert yaml_text.load_lines(path) is None
    assert isinstance(read_manifest(path), Manifest)
    assert yaml_text.load(path)[0]["clips"][0]["id"] == "c1"
