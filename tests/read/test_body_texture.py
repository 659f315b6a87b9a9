"""Texture coordinates of a body, from an .obj in any order or an .npz."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from gmrdata.read.body_file import read_picture, read_uv
from gmrdata.values.errors import BadBodyFile, GmrdataError, MissingInput

FACES = np.array([[0, 1, 2], [2, 1, 3]])
VT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.25, 0.75]])
FT = np.array([[0, 1, 2], [4, 1, 3]])


def obj(lines: str, folder: Path) -> Path:
    path = folder / "uv.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n# made\n" + lines)
    return path


def vt_lines() -> str:
    return "".join(f"vt {u} {v}\n" for u, v in VT)


def test_an_obj_in_another_order_and_from_another_corner(tmp_path):
    path = obj(vt_lines() + "f 2/2/1 4/4/1 3/5/1\nf 1/1 2/2 3/3\n", tmp_path)
    np.testing.assert_array_equal(read_uv(path, FACES), VT[FT])


def test_an_npz_of_vt_and_ft(tmp_path):
    names = np.array({"head": 15}, dtype=object)  # as SMPLX_NEUTRAL.npz has joint2num
    np.savez(tmp_path / "model.npz", vt=VT, ft=FT.astype(np.uint32), joint2num=names)
    np.testing.assert_array_equal(read_uv(tmp_path / "model.npz", FACES), VT[FT])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("f 1/1 2/2 3/3\n", "has 1 triangles, but the body has 2"),
        ("f 1/1 2/2 3/3\nf 1/1 2/2 4/4\n", r"has no triangle of the body's vertices \(2, 1, 3\)"),
        ("f 1/1 2/2 3/3\nf 3/5 2/2 4/9\n", "its faces name 9 texture coordinates, and it has 5"),
        ("f 1/1 2/2 3/3\nf 3 2 4\n", r"uv\.obj, line 12: neither `vt u v` nor a triangle"),
        ("f 1/1 2/2 4/4 3/3\n", r"line 11: neither `vt u v` nor a triangle"),
        ("vt 0.5\n", r"line 11: neither"),
        ("vt nan 0\nf 1/6 2/2 3/3\nf 3/5 2/2 4/4\n", "not finite"),
    ],
)
def test_a_wrong_obj_is_refused_with_its_reason(tmp_path, lines, message):
    path = obj(vt_lines() + lines, tmp_path)
    with pytest.raises(BadBodyFile, match=message):
        read_uv(path, FACES)


def test_a_wrong_npz_is_refused(tmp_path):
    np.savez(tmp_path / "no.npz", f=FACES)
    with pytest.raises(BadBodyFile, match="has no vt and no ft"):
        read_uv(tmp_path / "no.npz", FACES)
    np.savez(tmp_path / "few.npz", vt=VT, ft=FT[:1])
    with pytest.raises(BadBodyFile, match="but the body has 2 faces"):
        read_uv(tmp_path / "few.npz", FACES)
    np.savez(tmp_path / "words.npz", vt=VT.astype(str), ft=FT)
    with pytest.raises(BadBodyFile, match=r"words\.npz"):
        read_uv(tmp_path / "words.npz", FACES)
    (tmp_path / "cut.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(BadBodyFile):
        read_uv(tmp_path / "cut.npz", FACES)


def test_files_that_are_not_there_or_of_no_known_kind(tmp_path):
    for read in (lambda p: read_uv(p, FACES), read_picture):
        with pytest.raises(MissingInput):
            read(tmp_path / "gone.obj")
    (tmp_path / "uv.ply").write_text("ply")
    with pytest.raises(BadBodyFile, match=r"an \.obj, or an \.npz"):
        read_uv(tmp_path / "uv.ply", FACES)
    (tmp_path / "noise.png").write_bytes(bytes(range(256)))
    with pytest.raises(GmrdataError, match=r"noise\.png: not a picture"):
        read_picture(tmp_path / "noise.png")


def test_a_picture_has_its_top_row_first_and_red_first(tmp_path):
    pixels = np.zeros((2, 3, 3), np.uint8)
    pixels[0, :, 2] = 255  # OpenCV's order is blue, green, red
    cv2.imwrite(str(tmp_path / "red.png"), pixels)
    picture = read_picture(tmp_path / "red.png")
    np.testing.assert_array_equal(picture[0], [[1.0, 0, 0]] * 3)
    assert picture.shape == (2, 3, 3) and not picture[1].any()
