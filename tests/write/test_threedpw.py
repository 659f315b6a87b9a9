"""What is written is what is read, by this package and by pickle itself."""

import pickle  # noqa: TID251  The oracle: what every other reader of 3DPW uses.
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmrdata.read.threedpw_files import SequenceArrays, ThreedpwPerson, read_sequence_file
from gmrdata.values.errors import BadSequence
from gmrdata.write.threedpw import sequence_bytes, write_sequence
from tests.write.test_pickles import names_of_numpy_alone

KEYS = {
    "sequence", "betas", "poses", "trans", "poses_60Hz", "trans_60Hz", "betas_clothed",
    "v_template_clothed", "genders", "texture_maps", "poses2d", "jointPositions", "img_frame_ids",
    "cam_poses", "campose_valid", "cam_intrinsics",
}  # fmt: skip
"""Every key of 3DPW's own files."""


def same(a: object, b: object) -> bool:
    """Equal to the last bit: types, shapes, NaN and the sign of zero included."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return (a.shape, a.dtype, a.tobytes()) == (b.shape, b.dtype, b.tobytes())
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, ThreedpwPerson | SequenceArrays) and type(a) is type(b):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b


floats = st.floats(width=64, allow_nan=True, allow_infinity=True)


def array(*shape: int) -> st.SearchStrategy[np.ndarray]:
    return hnp.arrays(np.float64, shape, elements=floats, fill=st.floats(-3, 3))


@st.composite
def sequences(draw: st.DrawFn) -> SequenceArrays:
    n, m = draw(st.integers(1, 5)), draw(st.integers(0, 11))
    n_betas, n_vertices = draw(st.integers(10, 13)), draw(st.integers(0, 4))
    with_optional = draw(st.booleans())
    finite = hnp.arrays(np.float64, (n_betas,), elements=st.floats(-9, 9))
    people = [
        ThreedpwPerson(
            poses_rad=draw(array(n, 72)),
            trans_m=draw(array(n, 3)),
            betas=draw(finite),
            gender=draw(st.sampled_from(["female", "male"])),
            campose_valid=draw(hnp.arrays(np.bool_, (n,))),
            poses2d_px=draw(array(n, 18, 3)),
            poses_60hz_rad=draw(array(m, 72)) if with_optional else None,
            trans_60hz_m=draw(array(m, 3)) if with_optional else None,
            joints_world_m=draw(array(n, 24, 3)) if with_optional else None,
            betas_clothed=draw(array(n_betas)) if with_optional else None,
            template_clothed_m=draw(array(n_vertices, 3)) if with_optional else None,
        )
        for _ in range(draw(st.integers(1, 2)))
    ]
    positive = st.floats(1e-3, 1e5)
    focal_x, focal_y, x, y = draw(st.tuples(positive, positive, positive, positive))
    return SequenceArrays(
        name=draw(st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,30}", fullmatch=True)),
        intrinsics_px=np.array([[focal_x, 0.0, x], [0.0, focal_y, y], [0.0, 0.0, 1.0]]),
        cam_from_world=draw(array(n, 4, 4)),
        img_frame_ids=draw(hnp.arrays(np.int64, (n,), elements=st.integers(0, 65535))),
        people=tuple(people),
    )


@given(arrays=sequences())
def test_reading_gives_back_what_was_written(arrays, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "some.pkl"
    path.write_bytes(sequence_bytes(arrays))
    assert same(read_sequence_file(path), arrays)


def test_pickle_itself_finds_every_key_in_3dpws_form(walk_arrays, tmp_path):
    files = write_sequence(tmp_path, "test", walk_arrays)
    data = files.pickle_path.read_bytes()
    found = pickle.loads(data, encoding="latin1")  # as every loader of 3DPW does
    n, first = walk_arrays.n_frames, walk_arrays.people[0]
    assert found.keys() == KEYS
    assert found["sequence"] == walk_arrays.name and found["genders"] == ["f", "m"]
    assert found["texture_maps"] == []
    assert found["poses2d"][0].shape == (n, 3, 18)
    assert np.array_equal(found["poses2d"][0][:, 0], first.poses2d_px[:, :, 0])
    assert found["jointPositions"][0].shape == (n, 72)
    assert found["poses_60Hz"][1].shape == (2 * n, 72)
    assert found["img_frame_ids"].dtype == np.uint16
    assert found["img_frame_ids"].tolist() == list(range(0, 2 * n, 2))
    assert [valid.dtype for valid in found["campose_valid"]] == [np.uint8, np.uint8]
    assert np.array_equal(found["poses_60Hz"][0][found["img_frame_ids"]], found["poses"][0])
    with pytest.raises(UnicodeDecodeError):  # Python 2's strings, as in the real files
        pickle.loads(data)


def test_the_file_is_protocol_2_and_imports_three_names_of_numpy(walk_arrays, tmp_path):
    data = write_sequence(tmp_path, "test", walk_arrays).pickle_path.read_bytes()
    opcodes = names_of_numpy_alone(data)
    assert opcodes[0][0].name == "PROTO" and opcodes[0][1] == 2
    assert not [opcode for opcode, _, _ in opcodes if "UNICODE" in opcode.name]


def test_the_same_arrays_give_the_same_bytes_and_no_half_file(walk_arrays, tmp_path):
    one = write_sequence(tmp_path / "a", "train", walk_arrays).pickle_path
    two = write_sequence(tmp_path / "b", "train", walk_arrays).pickle_path
    assert one.read_bytes() == two.read_bytes()
    assert [path.name for path in one.parent.iterdir()] == [one.name]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda a: replace(a, name="../a"), "no name of a sequence"),
        (lambda a: replace(a, img_frame_ids=a.img_frame_ids + 65_500), "uint16"),
        (lambda a: replace(a, people=(replace(a.people[0], gender="neutral"),)), "neutral"),
        (
            lambda a: replace(a, people=(replace(a.people[0], joints_world_m=None), a.people[1])),
            "only some people have jointPositions",
        ),
    ],
)
def test_what_3dpw_has_no_place_for_is_refused(walk_arrays, change, said, tmp_path):
    with pytest.raises(BadSequence, match=said):
        (tmp_path / "a.pkl").write_bytes(sequence_bytes(change(walk_arrays)))
    assert not list(tmp_path.iterdir())


def test_an_unknown_split_is_refused(walk_arrays, tmp_path):
    with pytest.raises(BadSequence, match="no split 'all'"):
        write_sequence(tmp_path, "all", walk_arrays)
