"""ASF/AMC: dof order, axes, units; what does not fit together says so."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.amc import find_asf, read_amc, read_asf
from gmrdata.values.errors import BadMotionFile, GmrdataError, MissingInput
from gmrdata.values.skinning import global_rotmats, joint_positions_m
from tests.damage import in_one_folder, part_replaced

ASF = """# a comment
:version 1.10
:name TEST
:units
  mass 1.0
  length 0.5
  angle deg
:documentation
   anything: at all
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name thigh
     direction 0 -2 0
     length 4
     axis 0 0 90 XYZ
    dof rx rz
    limits (-160.0 20.0)
           (-70.0 70.0)
  end
  begin
     id 2
     name shank
     direction 0 -1 0
     length 3
     axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root thigh
    thigh shank
  end
"""
AMC = """#!OML:ASF H:\\somewhere\\TEST.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 90 0
thigh 90 0
2
root 1 2 4 0 0 0
thigh 0 90
3
root 1 2 5 10 20 30
thigh 0 0
"""


def _write(folder: Path, asf: str = ASF, amc: str = AMC) -> Path:
    (folder / "07.asf").write_text(asf)
    (folder / "07_01.amc").write_text(amc)
    return folder / "07_01.amc"


def test_directions_axes_and_order(tmp_path):
    source = read_amc(_write(tmp_path), fps_hz=50)
    assert source.names == ("root", "thigh", "shank")
    assert source.fps_hz == 50.0
    inch_m = 0.0254 / 0.5
    rotmats = global_rotmats(source.parents, source.local_rotmats)
    positions = joint_positions_m(source.parents, rotmats, source.translations_m) / inch_m
    np.testing.assert_allclose(positions[:, 0], [[1, 2, 3], [1, 2, 4], [1, 2, 5]])
    # Frame 1: rx of a bone whose axis is turned by 90 about z turns it about y, so the thigh stays
    # down.  Frame 2: rz is z in either frame: down goes to +x.
    np.testing.assert_allclose(positions[0, 2], [1, -2, 3], atol=1e-12)
    np.testing.assert_allclose(positions[1, 2], [5, 2, 4], atol=1e-12)
    # rz after ry after rx about fixed axes: the root's x axis in frame 3.
    x, y, z = np.deg2rad([10, 20, 30])
    np.testing.assert_allclose(
        rotmats[2, 0, :, 0], [np.cos(y) * np.cos(z), np.cos(y) * np.sin(z), -np.sin(y)]
    )
    assert np.arcsin(rotmats[2, 0, 2, 1] / np.cos(y)) == pytest.approx(x)


def test_radians_and_given_unit(tmp_path):
    radians = AMC.replace(":DEGREES", ":RADIANS").replace(" 90", f" {np.pi / 2}")
    radians = radians.replace("10 20 30", " ".join(str(np.deg2rad(a)) for a in (10, 20, 30)))
    (tmp_path / "r").mkdir()
    in_radians = read_amc(_write(tmp_path / "r", amc=radians), fps_hz=50, unit_m=2.0)
    in_degrees = read_amc(_write(tmp_path), fps_hz=50)
    np.testing.assert_allclose(in_radians.local_rotmats, in_degrees.local_rotmats, atol=1e-12)
    np.testing.assert_allclose(in_radians.translations_m[0, :2], [[2, 4, 6], [0, 0, 0]])
    np.testing.assert_allclose(in_radians.tips_m[1], [0, -8, 0])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("thigh 90 0\n", "thigh  90 0 \n"),
        ("thigh 90 0\n", "\tthigh\t90 0\n"),
        ("thigh 90 0\n", "\n \nthigh 90 0\r\n"),
        ("thigh 90 0\n", "thigh +90. -.0e1\n"),
        ("thigh 90 0\n2\n", "thigh 90 0\n02\n"),
    ],
)
def test_frames_that_need_a_closer_look_are_read_as_the_plain_ones(tmp_path, old, new):
    (tmp_path / "odd").mkdir()
    assert old in AMC
    plain = read_amc(_write(tmp_path), fps_hz=50)
    odd = read_amc(_write(tmp_path / "odd", amc=AMC.replace(old, new, 1)), fps_hz=50)
    np.testing.assert_array_equal(odd.local_rotmats, plain.local_rotmats)
    np.testing.assert_array_equal(odd.translations_m, plain.translations_m)


BROKEN_AMC = [
    ("thigh 90 0\n2", "foot 90 0\n2", ":6: bone foot is not in 07.asf.*put 07_01.asf beside it"),
    ("thigh 90 0\n2", "thigh 90\n2", ":6: 1 values for thigh, where 07.asf has 2"),
    ("thigh 90 0\n2", "2", "have no thigh, which 07.asf has"),
    ("thigh 0 90\n", "", ":9: '3' where thigh with 2 values is due"),
    ("thigh 0 90\n", "thigh 0 90 5\n", ":9: 'thigh 0 90 5' where thigh with 2 values"),
    ("thigh 0 90\n", "thigh 0 nan\n", ":9: nan is not a usable number"),
    ("thigh 0 90\n", "thigh 0 1e9\n", ":9: 1e9 is not a usable number"),
    ("thigh 0 90\n", "thigh 0 y\n", ":9: 'y' is not a number"),
    ("thigh 0 90\n", "thigh 0 9_0\n", ":9: '9_0' is not a number"),
    ("thigh 0 90\n", "thigh 0 true\n", ":9: 'true' is not a number"),
    ("thigh 0 90\n", "thigh 0,90\n", ":9: 'thigh 0.90' where thigh with 2 values"),
    ("2 4 0 0 0\nthigh 0 90\n", "2 4 0 0\n0 thigh 0 90\n", ":8: 'root 1 2 4 0 0' where root"),
    ("\n3\n", "\n4\n", "frame 4 follows frame 2"),
    ("\n2\n", "\nx 2\n", "bone x is not in 07.asf"),
    ("thigh 0 0\n", "", ":11: the last frame is not complete"),
    (AMC[AMC.index("\n2\n") :], "\n", "1 recorded frames are no motion"),
    (AMC[AMC.index("1\nroot") :], "", "no frames"),
    ("1\nroot", "root", ":4: 'root 1 2 3 0 90 0' where the first frame's number is due"),
]
BROKEN_ASF = [
    (":bonedata", ":bones", "no section :bonedata"),
    ("angle deg", "angle grad", ":7: :units must say"),
    ("length 0.5", "length 0", ":6: :units must give one positive 'length'"),
    ("length 0.5", "length 1e-320", ":6: :units must give one positive 'length'"),
    ("order TX TY", "order TX TX", ":11: the root's order"),
    ("position 0 0 0", "position 0 0", ":root needs a line 'position' with 3 values"),
    ("dof rx rz", "dof rx l", ":22: dof 'rx l'"),
    ("dof rx rz", "dof rx rx", ":22: dof 'rx rx'"),
    ("direction 0 -2 0", "direction 0 0 0", ":19: a bone's direction is zero"),
    ("direction 0 -2 0", "direction 0 -2", ":19: a bone needs 'direction' with 3 values"),
    ("length 4", "length four", ":20: 'four' is not a number"),
    ("axis 0 0 90 XYZ", "axis 0 0 90 XYX", ":21: an axis is three angles and an order"),
    ("name shank", "name thigh", ":32: a second bone of the name thigh"),
    ("  end\n  begin\n     id 2", "  begin\n     id 2", "'begin' and 'end' do not alternate"),
    ("  end\n:hierarchy", ":hierarchy", "the last bone of :bonedata has no 'end'"),
    ("thigh shank", "shin shank", ":36: shin has no parent yet"),
    ("thigh shank", "thigh shin", ":36: bone shin is not in :bonedata"),
    ("    thigh shank\n", "", "does not reach the bones shank"),
]


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [("07_01.amc", *row) for row in BROKEN_AMC] + [("07.asf", *row) for row in BROKEN_ASF],
)
def test_broken_files(tmp_path, name, old, new, words):
    path = _write(tmp_path)
    assert old in (tmp_path / name).read_text()
    (tmp_path / name).write_text((tmp_path / name).read_text().replace(old, new, 1))
    with pytest.raises(BadMotionFile, match=words) as caught:
        read_amc(path, fps_hz=50)
    assert str(tmp_path / name) in str(caught.value)


def test_the_rate_of_a_skeleton_that_is_not_cmus_must_be_given(tmp_path):
    with pytest.raises(BadMotionFile, match="holds no frame rate; give it with --fps-hz"):
        read_amc(_write(tmp_path))
    with pytest.raises(BadMotionFile, match="fps-hz"):
        read_amc(_write(tmp_path), fps_hz=-1)


def test_the_skeleton_beside_it(tmp_path):
    path = _write(tmp_path)
    assert find_asf(path) == tmp_path / "07.asf"
    (tmp_path / "07_01.asf").write_text(ASF)
    assert find_asf(path) == tmp_path / "07_01.asf"
    for name in ("07.asf", "07_01.asf"):
        (tmp_path / name).unlink()
    with pytest.raises(
        MissingInput, match=r"07\.asf is not beside it.*; put it there, under a name with which"
    ):
        read_amc(path, fps_hz=50)
    (tmp_path / "anyone.asf").write_text(ASF)
    assert find_asf(path) == tmp_path / "anyone.asf"


def test_the_skeleton_of_another_subject_is_not_taken(tmp_path):
    path = _write(tmp_path)
    for name in ("02.asf", "02_01.asf"):
        other = next(tmp_path.glob("*.asf")).rename(tmp_path / name)
        with pytest.raises(MissingInput, match=rf"its skeleton 07\.asf is not .* \({other.name}\)"):
            read_amc(path, fps_hz=50)
    own = other.rename(tmp_path / "7.asf")
    assert find_asf(path) == own


@in_one_folder(150)
@given(data=st.data())
def test_damage_never_raises_anything_else(data, tmp_path):
    path = _write(tmp_path)
    damaged = data.draw(st.sampled_from([path, tmp_path / "07.asf"]))
    damaged.write_bytes(part_replaced(data, damaged.read_bytes()))
    try:
        source = read_amc(path, fps_hz=50)
    except GmrdataError as error:
        assert str(tmp_path) in str(error)
    else:
        assert np.isfinite(source.local_rotmats).all() and np.isfinite(source.translations_m).all()


def test_cmus_unit(cmu_dir):
    asf = read_asf(cmu_dir / "amc" / "02.asf")
    assert asf.unit_m == pytest.approx((1 / 0.45) * 2.54 / 100)
    assert np.linalg.norm(asf.bones_m[asf.names.index("lfemur")]) == pytest.approx(
        7.59371 * 0.0564444
    )
