"""Our manifest beside Table 7: rows by hand, and a set of frames per clip as the oracle."""

import csv
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.manifest.current import (
    ClipEntry,
    DroppedRange,
    FileRecord,
    FrameRange,
    ListedClip,
    Quality,
    Source,
)
from gmrdata.manifest.write import write_manifest
from gmrdata.paper.table7 import compare, compare_with_table7, summary, table_rows, write_csv
from gmrdata.values.errors import BadManifest, MissingInput
from tests.clip_manifests import a_head

FPS_HZ = 30.0
ACCEPTED = Quality(verdict="accepted")


def clip_of(
    sequence: str,
    person: int,
    n_frames: int,
    kept: list[tuple[int, int]],
    camera_motion: Any = "panning",
    quality: Quality | None = ACCEPTED,
) -> ClipEntry:
    rows = {row for start, stop in kept for row in range(start, stop)}
    dropped = [
        DroppedRange(start=row, stop=row + 1, reason="no camera was found")
        for row in range(n_frames)
        if row not in rows
    ]
    return ClipEntry(
        id=f"{sequence}.p{person}",
        source=Source(dataset="3DPW", sequence=sequence, person=str(person)),
        licence="3DPW's",
        body="smpl-female",
        fps_hz=FPS_HZ,
        n_frames=n_frames,
        frame="world",
        translation_of="smpl_transl",
        camera_motion=camera_motion,
        kept=tuple(FrameRange(start=start, stop=stop) for start, stop in kept),
        dropped=tuple(dropped),
        arrays=FileRecord(path=f"{sequence}.p{person}.npz", size_bytes=1, sha256="0" * 64),
        quality=quality,
    )


def listed_of(sequence: str, start: int, stop: int, camera_motion: Any = "panning") -> ListedClip:
    return ListedClip(
        id=f"{sequence}.{start:05d}-{stop - 1:05d}",
        source=Source(dataset="3DPW", sequence=sequence),
        frames=FrameRange(start=start, stop=stop),
        fps_hz=FPS_HZ,
        camera_motion=camera_motion,
    )


WINDOWS = "downtown_windowShopping_00"
OURS = [
    # Table 7: frames 300-696, small.
    clip_of("courtyard_captureSelfies_00", 0, 700, [(0, 400), (500, 700)], "small"),
    clip_of("courtyard_captureSelfies_00", 1, 700, [(350, 450)], "static"),
    # Table 7: frames 48-327, panning, and 972-1542, linear.
    clip_of(WINDOWS, 0, 1600, [(0, 100), (900, 1600)], "linear"),
    # Table 7: frames 42-234, panning.
    clip_of(
        "downtown_walkBridge_01",
        0,
        300,
        [(42, 235)],
        quality=Quality(verdict="rejected", reasons=("a cut", "few inliers")),
    ),
    clip_of("downtown_bar_00", 0, 50, [(0, 20), (30, 50)], "circular", quality=None),
]


@pytest.fixture
def manifest_path(tmp_path) -> Path:
    return write_ours(tmp_path / "ours" / "threedpw.yaml", OURS)


def write_ours(path: Path, clips: list[ClipEntry], kind: str = "pseudo_gt") -> Path:
    return write_manifest(path, a_head(path.stem, kind), clips)


def test_rows_stand_beside_those_of_the_published_table(manifest_path):
    rows = compare_with_table7(manifest_path)
    table = table_rows(rows)
    assert len(table) == 17 + 1 + 1
    theirs = [row for row in table if row[8] != "not in our manifest"]
    assert theirs == [
        ("courtyard_captureSelfies_00", "0", "300-696", "small", "small", "74.8 %", "303",
         "accepted", ""),
        ("courtyard_captureSelfies_00", "1", "300-696", "small", "static", "25.2 %", "0",
         "accepted", ""),
        ("downtown_walkBridge_01", "0", "42-234", "panning", "panning", "100.0 %", "0",
         "rejected", "a cut"),
        (WINDOWS, "0", "48-327", "panning", "linear", "18.6 %", "177", "accepted", ""),
        (WINDOWS, "0", "972-1542", "linear", "linear", "100.0 %", "177", "accepted", ""),
        ("downtown_bar_00", "0", "-", "-", "circular", "-", "40", "-", "not in Table 7"),
    ]  # fmt: skip
    assert table[0] == (
        "courtyard_basketball_00", "-", "0-467", "small", "-", "-", "-", "-", "not in our manifest",
    )  # fmt: skip
    # Selfies: 100 + 197 frames of person 0, 350..449 of person 1, of which 400..449 are new.
    total = sum(row.listed.frames.stop - row.listed.frames.start for row in rows
                if row.listed is not None and row.clip is None) + 397 + 193 + 280 + 571  # fmt: skip
    covered = 297 + 50 + 52 + 571
    assert summary(rows) == (
        "Table 7: 17 rows, 4 in our manifest, 3 accepted; the camera's class agrees in 2 of 4; "
        f"{covered} of {total} frames ({100 * covered / total:.1f} %) are kept in accepted clips; "
        "sequences of ours that it lacks: 1"
    )


def test_the_command_takes_a_folder_and_writes_the_rows(manifest_path):
    (manifest_path.parent / "recipe.yaml").write_text("kind: threedpw\nseed: 3\n")
    (manifest_path.parent / "odd.yaml").write_text("{{{")
    out = manifest_path.parent / "compared.csv"
    command = [sys.executable, "-c", "from gmrdata.cli import main; main()"]
    answer = subprocess.run(
        [*command, "threedpw", "compare", str(manifest_path.parent), "--out", str(out)],
        capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "240"},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    said = " ".join(answer.stdout.split())
    assert said.startswith("sequence person Table 7 class there ours kept of it kept beyond")
    assert "downtown_walkBridge_01 0 42-234 panning panning 100.0 % 0 rejected a cut" in said
    assert "Table 7: 17 rows, 4 in our manifest, 3 accepted" in said
    with out.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 19
    assert rows[-1] == {
        "sequence": "downtown_bar_00", "person": "0", "table7_start": "", "table7_stop": "",
        "table7_camera_motion": "", "camera_motion": "circular", "same_camera_motion": "",
        "kept_share_of_table7": "", "kept_frames_beyond_table7": "40", "verdict": "",
        "reason": "not in Table 7",
    }  # fmt: skip
    bridge = next(row for row in rows if row["sequence"] == "downtown_walkBridge_01")
    assert (bridge["table7_start"], bridge["table7_stop"]) == ("42", "235")
    assert (bridge["same_camera_motion"], bridge["kept_share_of_table7"]) == ("true", "1.0")
    before = out.read_bytes()
    write_csv(out, compare_with_table7(manifest_path))
    assert out.read_bytes() == before


def test_what_is_no_pseudo_ground_truth_of_3dpw_is_refused(tmp_path):
    with pytest.raises(MissingInput, match=r"holds no manifest \(\.yaml\) of kind pseudo_gt"):
        compare_with_table7(tmp_path)
    with pytest.raises(MissingInput, match="no such manifest"):
        compare_with_table7(tmp_path / "none.yaml")
    motions = write_ours(tmp_path / "motions.yaml", OURS, kind="motions")
    with pytest.raises(BadManifest, match="is of kind motions; give one of kind pseudo_gt"):
        compare_with_table7(motions)
    cmu = [clip.model_copy(update={"source": Source(dataset="CMU", sequence="02_03")})
           for clip in OURS[:1]]  # fmt: skip
    with pytest.raises(BadManifest, match="no clip whose source is 3DPW"):
        compare_with_table7(write_ours(tmp_path / "a.yaml", cmu))
    write_ours(tmp_path / "b.yaml", OURS)
    with pytest.raises(BadManifest, match=r"several manifests of kind pseudo_gt: a\.yaml, b\.yaml"):
        compare_with_table7(tmp_path)


N = 30
spans = st.tuples(st.integers(0, N - 1), st.integers(1, N)).filter(lambda s: s[0] < s[1])
keeps = st.sets(st.integers(0, N - 1)).map(
    lambda rows: [(row, row + 1) for row in sorted(rows)]
)  # single frames: ranges that meet are allowed in a manifest


@given(
    table=st.lists(spans, min_size=1, max_size=3, unique=True),
    people=st.lists(st.tuples(keeps, st.booleans()), max_size=2),
)
def test_shares_are_those_of_sets_of_frames(table, people):
    listed = [listed_of("s", *span) for span in table]
    clips = [
        clip_of("s", who, N, kept, quality=ACCEPTED if good else Quality(verdict="rejected"))
        for who, (kept, good) in enumerate(people)
    ]
    rows = compare(clips, listed)
    assert len(rows) == len(listed) * max(1, len(clips))
    named = {row for span in table for row in range(*span)}
    ours = [{start for start, _ in kept} for kept, _ in people]
    covered = 0
    for k, span in enumerate(table):
        wanted = set(range(*span))
        for who, kept in enumerate(ours):
            row = rows[k * len(ours) + who]
            assert row.kept_share == len(kept & wanted) / len(wanted)
            assert row.kept_beyond == len(kept - named)
        accepted = [kept for kept, (_, good) in zip(ours, people, strict=True) if good]
        covered += len(set().union(*accepted) & wanted)
    total = sum(stop - start for start, stop in table)
    assert f"; {covered} of {total} frames" in summary(rows)
