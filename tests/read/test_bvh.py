"""BVH: what was written is read; broken files say where and what to do."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.bvh import read_bvh
from gmrdata.read.source_motion import SourceMotion
from gmrdata.values.errors import BadMotionFile, MissingInput
from gmrdata.values.skinning import global_rotmats, joint_positions_m
from tests.damage import in_one_folder, part_replaced, read_or_refused

GOOD = """HIERARCHY
ROOT a
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT b
  {
    OFFSET 0 1 0
    CHANNELS 2 Yrotation Xrotation
    End Site
    {
      OFFSET 0 2 0
    }
  }
}
MOTION
Frames: 3
Frame Time: .0083333
1 2 3 90 0 0 0 90
1 2 4 90 0 0 0 90
1 2 5 90 0 0 0 90
"""


def _axis_rotation(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    k = "XYZ".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    rotmat = np.eye(3)
    rotmat[i, i], rotmat[i, j], rotmat[j, i], rotmat[j, j] = c, -s, s, c
    return rotmat


def _naive_positions(names, parents, offsets, channels, row) -> np.ndarray:
    """One frame, joint by joint, straight from the format's description."""
    positions, rotmats, column = [], [], 0
    for joint, parent in enumerate(parents):
        offset, rotmat = offsets[joint].copy(), np.eye(3)
        for channel in channels[joint]:
            if channel.endswith("position"):
                offset["XYZ".index(channel[0])] = row[column]
            else:
                rotmat = rotmat @ _axis_rotation(channel[0], row[column])
            column += 1
        if parent < 0:
            positions.append(offset)
            rotmats.append(rotmat)
        else:
            positions.append(positions[parent] + rotmats[parent] @ offset)
            rotmats.append(rotmats[parent] @ rotmat)
    return np.array(positions)


@st.composite
def _skeletons(draw):
    n_joints = draw(st.integers(1, 6))
    # Depth-first: a parent is one of the joints on the way from the root to the joint before.
    parents = [-1]
    for joint in range(1, n_joints):
        chain = [joint - 1]
        while parents[chain[-1]] >= 0:
            chain.append(parents[chain[-1]])
        parents.append(draw(st.sampled_from(chain)))
    axes = st.permutations(["X", "Y", "Z"]).flatmap(
        lambda p: st.integers(0, 3).map(lambda n: list(p[:n]))
    )
    channels = []
    for _ in range(n_joints):
        found = [f"{axis}rotation" for axis in draw(axes)]
        found += [f"{axis}position" for axis in draw(axes)]
        channels.append(draw(st.permutations(found)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_columns = sum(map(len, channels))
    rows = rng.uniform(-300, 300, (draw(st.integers(2, 4)), n_columns)).round(6)
    return (
        [f"j{i}" for i in range(n_joints)],
        parents,
        rng.normal(size=(n_joints, 3)),
        channels,
        rows,
    )


def _fk(source: SourceMotion) -> np.ndarray:
    rotmats = global_rotmats(source.parents, source.local_rotmats)
    return joint_positions_m(source.parents, rotmats, source.translations_m)


@in_one_folder(60)
@given(skeleton=_skeletons())
def test_a_written_skeleton_is_read_as_the_format_means_it(skeleton, write_bvh, tmp_path):
    names, parents, offsets, channels, rows = skeleton
    path = write_bvh(tmp_path / "a.bvh", names, parents, offsets, channels, rows)
    if sum(map(len, channels)) == 0:
        with pytest.raises(BadMotionFile, match="no channels"):
            read_bvh(path, unit_m=1.0, drop_rest_frame=False)
        return
    source = read_bvh(path, unit_m=1.0, drop_rest_frame=False)
    assert list(source.names) == names
    assert list(source.parents) == parents
    expected = [_naive_positions(names, parents, offsets, channels, row) for row in rows]
    np.testing.assert_allclose(_fk(source), expected, atol=1e-9)


def test_one_channel_of_a_place_stands_for_its_offset(write_bvh, tmp_path):
    """However small it is: a place beside the offset has all three."""
    offsets, channels = np.array([[0.0, 0, 0], [0, 0, -2]]), [["Xrotation"], ["Zposition"]]
    path = write_bvh(tmp_path / "a.bvh", ["a", "b"], [-1, 0], offsets, channels, np.zeros((2, 2)))
    source = read_bvh(path, unit_m=1.0, drop_rest_frame=False)
    np.testing.assert_array_equal(source.translations_m[:, 1], np.zeros((2, 3)))


def test_hips_that_stand_near_nothing_are_where_their_channels_say(write_bvh, tmp_path):
    """Bandai Namco's hang on a root that stands still, and their offset is where one began."""
    offsets = np.array([[0.0, 0, 0], [5, 91, -427], [16, 0, 0], [9, -1, 0]])
    place = ["Xposition", "Yposition", "Zposition"]
    rows = np.concatenate([np.zeros((3, 3)), np.tile(offsets[1:].ravel(), (3, 1))], axis=1)
    rows[:, 3:6] = [[-4, 80, 38], [-3, 83, 37], [-2, 82, 36]]
    path = write_bvh(tmp_path / "a.bvh", list("abcd"), [-1, 0, 1, 2], offsets, [place] * 4, rows)
    source = read_bvh(path, unit_m=1.0, drop_rest_frame=False)
    np.testing.assert_allclose(source.translations_m.reshape(3, -1), rows, atol=1e-12)


def test_hips_that_walk_say_nothing_of_whether_others_are_moved_from_their_offsets(
    write_bvh, tmp_path
):
    """Half of two joints with a place are not most: the hand came to lie in the hips."""
    offsets = np.array([[0.0, 0, 0], [0, 90, 0], [20, 10, 0]])
    place = ["Xposition", "Yposition", "Zposition"]
    rows = np.zeros((3, 9))
    rows[:, 3:6] = [[0, 88, 100], [0, 89, 200], [0, 88, 300]]
    path = write_bvh(tmp_path / "a.bvh", list("abc"), [-1, 0, 1], offsets, [place] * 3, rows)
    source = read_bvh(path, unit_m=1.0, drop_rest_frame=False)
    np.testing.assert_allclose(source.translations_m[:, 1], rows[:, 3:6], atol=1e-12)
    np.testing.assert_allclose(source.translations_m[:, 2], [offsets[2]] * 3, atol=1e-12)


def test_units_rate_and_end_sites(tmp_path):
    path = tmp_path / "a.bvh"
    path.write_text(GOOD)
    source = read_bvh(path)
    assert source.fps_hz == 120.0
    np.testing.assert_allclose(source.tips_m, [[np.nan] * 3, [0, 0.02, 0]])
    # Root turned by 90 degrees about z takes b's offset from y to -x; units are centimetres.
    np.testing.assert_allclose(_fk(source)[1], [[0.01, 0.02, 0.04], [0.0, 0.02, 0.04]], atol=1e-15)
    assert read_bvh(path, fps_hz=25, unit_m=1.0).fps_hz == 25.0


def test_offsets_that_stand_in_the_channels_alone_are_found(tmp_path):
    """As FBX converters write: every OFFSET is zero, and each joint has its place in each frame."""
    good = tmp_path / "good.bvh"
    good.write_text(GOOD)
    both = "CHANNELS 5 Xposition Yposition Zposition Yrotation Xrotation"
    text = GOOD.replace("CHANNELS 2 Yrotation Xrotation", both).replace(
        "OFFSET 0 1 0", "OFFSET 0 0 0"
    )
    other = tmp_path / "other.bvh"
    other.write_text(text.replace("90 0 0 0 90", "90 0 0 0 1 0 0 90"))
    found, expected = read_bvh(other), read_bvh(good)
    np.testing.assert_array_equal(found.offsets_m, expected.offsets_m)
    np.testing.assert_array_equal(found.translations_m, expected.translations_m)


def test_windows_line_ends_tabs_and_joined_braces_are_the_same_file(tmp_path):
    plain, odd = tmp_path / "a.bvh", tmp_path / "b.bvh"
    plain.write_text(GOOD)
    odd.write_text(
        GOOD.replace("\n{", " {").replace("OFFSET ", "OFFSET\t").replace("\n", "\r\n"), newline=""
    )
    np.testing.assert_array_equal(_fk(read_bvh(plain)), _fk(read_bvh(odd)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1 2 4 90 0 0 0 90", "1 2 4 90 0 0 0", r":20: 7 numbers where the channels need 8"),
        ("1 2 4 90 0 0 0 90", "1 2 4 90 0 0 0 nan", r":20: nan is not a usable number"),
        ("1 2 4 90 0 0 0 90", "1 2 4 90 0 0 0 1e300", r":20: 1e300 is not a usable number"),
        ("1 2 4 90 0 0 0 90", "1 2 4 90 0 x 0 90", r":20: 'x' is not a number"),
        ("1 2 4 90 0 0 0 90", "1 2 4 90 0 1_0 0 90", r":20: '1_0' is not a number"),
        ("Frames: 3", "Frames: 4", "promises 4 frames and the file has 3.*Frames:"),
        ("Frames: 3", "Frames: -3", r":17: '-3' is no number of frames"),
        ("Frames: 3", "Frame: 3", "must follow MOTION"),
        (".0083333", "0", r":18: a frame time of 0 s.*fps-hz"),
        (".0083333", "-0.01", r":18: .*fps-hz"),
        (".0083333", "0.0001", r":18: .*fps-hz"),
        (".0083333", "nan", r":18: .*fps-hz"),
        (".0083333", "fast", r":18: frame time 'fast' is not a number"),
        ("CHANNELS 2 Yrotation", "CHANNELS 3 Yrotation", r":9: CHANNELS needs its count"),
        ("CHANNELS 2 Yrotation", "CHANNELS 2 Wrotation", r":9: CHANNELS needs its count"),
        ("CHANNELS 2 Yrotation", "CHANNELS 2 Xrotation", r":9: a channel is listed twice"),
        ("OFFSET 0 1 0", "OFFSET 0 1", r":8: an OFFSET has 3 numbers, not 2"),
        ("JOINT b", "JOINT a", r":6: a second joint of the name a"),
        ("JOINT b", "ROOT b", r":6: ROOT b is not inside the one ROOT"),
        ("JOINT b", "JOIN b", r":6: 'JOIN b' is not expected here"),
        ("JOINT b\n  {", "JOINT b", r":7: '\{' and joints do not alternate"),
        ("  }\n}\nMOTION", "  }\nMOTION", "a brace of the hierarchy is not closed"),
        ("MOTION", "MOTIO", "no line 'MOTION'"),
        (GOOD[:-40], "", "no line 'MOTION'"),
        ("ROOT a", "JOINT a", r":2: JOINT a is not inside the one ROOT"),
    ],
)
def test_broken_files_say_where_and_why(tmp_path, old, new, words):
    assert old in GOOD
    path = tmp_path / "a.bvh"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(BadMotionFile, match=words) as caught:
        read_bvh(path)
    assert str(path) in str(caught.value)


@in_one_folder(150)
@given(data=st.data())
def test_damage_never_raises_anything_else(data, tmp_path):
    source = read_or_refused(tmp_path / "a.bvh", part_replaced(data, GOOD.encode()), read_bvh)
    if source is not None:
        assert np.isfinite(source.local_rotmats).all() and np.isfinite(source.translations_m).all()


def _with_rows(path: Path, rows: list[str], text: str = GOOD) -> Path:
    head = text[: text.index("1 2 3 90")].replace("Frames: 3", f"Frames: {len(rows)}")
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def test_an_added_rest_pose_is_dropped_and_a_start_at_rest_is_not(tmp_path):
    path = tmp_path / "a.bvh"
    added = read_bvh(_with_rows(path, ["1 2 3 0 0 0 8 0", "1 2 3 5 1 2 30 9", "1 2 3 5 1 2 30 8"]))
    assert added.n_frames == 2
    assert "added rest pose in frame 0 dropped" in added.notes
    rows = ["1 2 3 0 0 0 8 0", "1 2 3 1 0 0 9 0", "1 2 3 5 1 2 30 8"]
    assert read_bvh(_with_rows(path, rows)).n_frames == 3
    assert read_bvh(path, drop_rest_frame=True).n_frames == 2
    turned = ["1 2 3 0 0.1 0 8 0", "1 2 3 5 1 2 30 9"]
    assert read_bvh(_with_rows(path, turned)).n_frames == 2


REFERENCE = GOOD.replace(
    "ROOT a\n", "ROOT r\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Yrotation Xrotation\nJOINT a\n"
).replace("}\nMOTION", "}\n}\nMOTION")


@pytest.mark.parametrize("turn", ["0 0 0", "0 0 -90"])
def test_a_rest_pose_is_found_under_a_joint_that_never_turns(tmp_path, turn):
    """As MotionBuilder writes: the Reference's frame is that of the scene."""
    path = tmp_path / "a.bvh"
    rows = [f"{turn} {row}" for row in ("1 2 3 0 0 0 8 0", "1 2 3 5 1 2 30 9", "1 2 3 5 1 2 30 8")]
    added = read_bvh(_with_rows(path, rows, REFERENCE))
    assert (added.n_frames, added.first_row) == (2, 1)
    assert "added rest pose in frame 0 dropped" in added.notes
    rows[0] = f"{turn} 1 2 3 0 0.1 0 8 0"
    assert read_bvh(_with_rows(path, rows, REFERENCE)).n_frames == 3


def test_names_in_another_encoding_stay_different(tmp_path):
    path = tmp_path / "a.bvh"
    text = GOOD.replace("ROOT a", "ROOT 頭").replace("JOINT b", "JOINT 首")
    path.write_bytes(text.encode("shift_jis"))
    assert read_bvh(path).names == (r"\x93\xaa", r"\x8e\xf1")


def _chain(n_joints: int) -> str:
    """A hierarchy as deep as it has joints."""
    joint = "JOINT j{}\n{{\nOFFSET 0 1 0\nCHANNELS 1 Xrotation\n"
    joints = "".join(joint.format(number) for number in range(n_joints))
    return "HIERARCHY\n" + joints.replace("JOINT", "ROOT", 1) + "}\n" * n_joints


def _moving(hierarchy: str, n_frames: int) -> str:
    rows = "0\n" * n_frames
    return f"{hierarchy}MOTION\nFrames: {n_frames}\nFrame Time: .01\n{rows}"


def _of_few_channels() -> str:
    """900 joints x 90,000 frames are 5.8 GB, of which the file has but one column."""
    head, _, rest = _chain(900).partition("CHANNELS 1 Xrotation\n")
    bare = rest.replace("CHANNELS 1 Xrotation", "")
    return _moving(f"{head}CHANNELS 1 Xrotation\n{bare}", 90_000)


ONE_FRAME = "\n".join(GOOD.replace("Frames: 3", "Frames: 1").split("\n")[:19])
LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:0\n"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: "", "empty"),
        (lambda: " \n", "empty"),
        (lambda: "\0\1\2", "binary"),
        (lambda: "x", "MOTION"),
        (lambda: LFS, "LFS pointer.*git lfs pull"),
        (lambda: ONE_FRAME, "at least 2"),
        (lambda: _moving(_chain(100_000), 2), r"a\.bvh:[0-9]+: more than 1000 joints"),
        (_of_few_channels, r"a\.bvh: holds more numbers than a file of"),
        (lambda: GOOD + "\n" * 1_100_000, r"a\.bvh: 1100[0-9]* lines, nearly all of them empty"),
    ],
)
def test_what_is_no_motion_at_all(make, words, tmp_path):
    (tmp_path / "a.bvh").write_text(make())
    with pytest.raises(BadMotionFile, match=words):
        read_bvh(tmp_path / "a.bvh")
    with pytest.raises(MissingInput, match="no such file"):
        read_bvh(tmp_path / "b.bvh")
