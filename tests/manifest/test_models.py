"""Models, YAML text and schema agree with each other."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from gmrdata.manifest import yaml_text
from gmrdata.manifest.current import (
    FORMAT,
    ClipEntry,
    CreatedBy,
    DroppedRange,
    FileRecord,
    FolderRecord,
    FrameRange,
    ListedClip,
    ListManifest,
    Manifest,
    Quality,
    Recipe,
    Source,
)
from gmrdata.manifest.read import json_schema, read_manifest
from gmrdata.manifest.write import manifest_text
from gmrdata.stage.recipes import schema_v1
from gmrdata.values import plain_yaml

texts = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
ids = st.from_regex(r"\A[A-Za-z0-9_][A-Za-z0-9_.-]{0,8}\Z")
parts = st.text(
    st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="/\\:\x7f"),
    min_size=1,
    max_size=6,
)
paths = st.lists(parts.filter(lambda part: part not in (".", "..")), min_size=1, max_size=3).map(
    "/".join
)
hashes = st.binary(min_size=32, max_size=32).map(bytes.hex)
numbers = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=1e-6, max_value=1e6)
counts = st.integers(0, 10**12)
motions = st.sampled_from(["static", "small", "panning", "linear", "linear_panning", "circular"])
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)
files = st.builds(FileRecord, path=paths, size_bytes=counts, sha256=hashes)
folders = st.builds(FolderRecord, folder=paths, count=counts, size_bytes=counts, listing=files)
sources = st.builds(Source, dataset=texts, sequence=texts, person=st.none() | texts)
recipes = st.builds(
    Recipe,
    stage=texts,
    config=st.dictionaries(texts, plain, max_size=3),
    inputs=st.dictionaries(texts, hashes, max_size=2),
    sha256=hashes,
)
qualities = st.builds(
    Quality,
    geometry=st.sampled_from(["exact", "full", "rotation_only", "static", None]),
    scale=st.none() | numbers,
    registered_share=st.none() | st.floats(0, 1),
    reasons=st.lists(texts, max_size=2).map(tuple),
    figures=st.dictionaries(texts, numbers, max_size=2),
)


@st.composite
def clips(draw: st.DrawFn) -> ClipEntry:
    kept, dropped, start = [], [], 0
    for reason in draw(st.lists(st.none() | texts, min_size=1, max_size=5)):
        stop = start + draw(st.integers(1, 100))
        if reason is None:
            kept.append(FrameRange(start=start, stop=stop))
        else:
            dropped.append(DroppedRange(start=start, stop=stop, reason=reason))
        start = stop
    return ClipEntry(
        id=draw(ids),
        source=draw(sources),
        licence=draw(texts),
        body=draw(texts),
        fps_hz=draw(positive),
        n_frames=start,
        frame=draw(st.sampled_from(["world", "camera"])),
        translation_of="smpl_transl",
        camera_motion=draw(motions | st.just("none")),
        kept=tuple(kept),
        dropped=tuple(dropped),
        arrays=draw(files),
        images=draw(st.none() | folders),
        masks=draw(st.none() | folders),
        quality=draw(st.none() | qualities),
        recipe=draw(st.none() | recipes),
    )


listed = st.builds(
    ListedClip,
    id=ids,
    source=sources,
    frames=st.integers(0, 99).map(lambda start: FrameRange(start=start, stop=start + 7)),
    fps_hz=positive,
    label=st.none() | texts,
    camera_motion=motions,
    programme=st.none() | motions,
    note=st.none() | texts,
)
heads = {
    "format": st.just(FORMAT),
    "name": ids,
    "version": st.sampled_from(["0.0.1", "1.10.3", "2.0.0-rc.1"]),
    "description": texts,
    "licence": texts,
    "created_by": st.builds(
        CreatedBy,
        gmrdata=texts,
        recipe=st.dictionaries(texts, plain, max_size=3),
        seeds=st.dictionaries(texts, counts, max_size=2),
    ),
}
by_id = {"max_size": 3, "unique_by": lambda clip: clip.id}
manifests = st.builds(
    Manifest,
    kind=st.sampled_from(["synthetic", "pseudo_gt", "motions"]),
    clips=st.lists(clips(), **by_id).map(tuple),
    **heads,
) | st.builds(
    ListManifest, kind=st.just("list"), clips=st.lists(listed, **by_id).map(tuple), **heads
)


@given(manifest=manifests)
def test_what_is_written_is_read(manifest, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "round_trip.yaml"
    text = manifest_text(manifest)
    path.write_bytes(text.encode())
    found = read_manifest(path)
    assert found == manifest
    assert manifest_text(found) == text


@given(value=st.dictionaries(texts, plain, max_size=4))
def test_yaml_keeps_every_value(value, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "plain.yaml"
    path.write_bytes(plain_yaml.dump(value).encode())
    assert yaml_text.load(path)[0] == value


def test_checked_in_schema_is_the_models():
    """If this fails: `python -m gmrdata.manifest.read`."""
    assert json.loads(schema_v1().read_text()) == json_schema()


def test_schema_explains_every_field():
    for name, model in json_schema()["$defs"].items():
        for field, schema in model["properties"].items():
            assert schema.get("description"), f"{name}.{field}"
        assert model["additionalProperties"] is False


def test_models_are_frozen():
    part = FrameRange(start=0, stop=1)
    with pytest.raises(ValidationError, match="frozen"):
        part.start = 1  # type: ignore[misc]


def test_golden_text():
    """The bytes of format 1: if this changes, released manifests change."""
    clip = ClipEntry(
        id="walk",
        source=Source(dataset="CMU", sequence="02_03"),
        licence="free",
        body="anny",
        fps_hz=10,
        n_frames=4,
        frame="world",
        translation_of="smpl_transl",
        camera_motion="circular",
        kept=(FrameRange(start=0, stop=3),),
        dropped=(DroppedRange(start=3, stop=4, reason="no camera found"),),
        arrays=FileRecord(path="clips/walk.npz", size_bytes=12, sha256="ab" * 32),
        quality=Quality(geometry="exact", scale_sigma=1e-7),
    )
    manifest = Manifest(
        format="gmrdata/1",
        name="golden",
        version="1.0.0",
        description="Grüße: one clip",
        licence="CC0-1.0",
        created_by=CreatedBy(gmrdata="0.1.0", recipe={"b": None, "a": [1, "02_03"]}),
        kind="synthetic",
        clips=(clip,),
    )
    assert manifest_text(manifest) == GOLDEN


GOLDEN = f"""\
format: gmrdata/1
name: golden
version: 1.0.0
description: 'Grüße: one clip'
licence: CC0-1.0
created_by:
  gmrdata: 0.1.0
  recipe:
    b: null
    a:
    - 1
    - '02_03'
kind: synthetic
clips:
- id: walk
  source:
    dataset: CMU
    sequence: '02_03'
  licence: free
  body: anny
  fps_hz: 10.0
  n_frames: 4
  frame: world
  translation_of: smpl_transl
  camera_motion: circular
  kept:
  - start: 0
    stop: 3
  dropped:
  - start: 3
    stop: 4
    reason: no camera found
  arrays:
    path: clips/walk.npz
    size_bytes: 12
    sha256: {"ab" * 32}
  quality:
    geometry: exact
    scale_sigma: 1.0e-07
"""
