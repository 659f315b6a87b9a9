"""Calibrations that others wrote, and the focal length in a picture's EXIF."""

import struct
from pathlib import Path

import numpy as np
import pytest

from gmrdata.cameras.colmap import pycolmap
from gmrdata.read.intrinsics import GIVEN_SIGMA, exif_lens, read_intrinsics, video_lens
from gmrdata.read.lens_files import COLMAP_OTHERS, COLMAP_TERMS
from gmrdata.values.camera import Lens
from gmrdata.values.errors import BadIntrinsics, MissingInput

SIZE_PX = (640, 480)


def text_file(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("line", "focal_px", "k1"),
    [
        ("1 SIMPLE_PINHOLE 640 480 600 320 240", (600, 600), 0.0),
        ("1 PINHOLE 640 480 600 605 320 240", (600, 605), 0.0),
        ("7 SIMPLE_RADIAL 640 480 600 320 240 -0.15", (600, 600), -0.15),
        ("1 RADIAL 640 480 600 320 240 0.1 0", (600, 600), 0.1),
        ("1 OPENCV 640 480 600 605 320 240 0.1 0 0 0", (600, 605), 0.1),
        ("1 SIMPLE_RADIAL 1280 960 1200 640 480 -0.15", (600, 600), -0.15),
    ],
)
def test_colmaps_cameras_are_read_at_the_size_of_the_frames(tmp_path, line, focal_px, k1):
    found = read_intrinsics(text_file(tmp_path, "cameras.txt", line), SIZE_PX)
    assert found.focal_px == focal_px
    assert found.centre_px == (320, 240)
    assert found.radial == (k1, 0) and found.size_px == SIZE_PX
    assert found.focal_from == ("given", GIVEN_SIGMA)


@pytest.mark.parametrize("model", ["PINHOLE", "SIMPLE_RADIAL"])
def test_what_colmap_writes_is_read_from_its_folder(tmp_path, model):
    params = {"PINHOLE": [600.0, 605, 322, 239], "SIMPLE_RADIAL": [600.0, 322, 239, -0.1]}[model]
    written = pycolmap.Reconstruction()
    written.add_camera_with_trivial_rig(
        pycolmap.Camera(model=model, width=640, height=480, params=params, camera_id=3)
    )
    written.write_binary(tmp_path)
    from_binary = read_intrinsics(tmp_path, SIZE_PX)
    written.write_text(tmp_path)
    assert read_intrinsics(tmp_path / "cameras.txt", SIZE_PX) == from_binary
    assert from_binary.focal_px == (600, params[1] if model == "PINHOLE" else 600)
    assert from_binary.centre_px == (322, 239)
    assert from_binary.radial == (0 if model == "PINHOLE" else -0.1, 0)


def test_every_camera_model_of_colmap_is_known_by_its_name():
    """Two of COLMAP 4.2's were refused by their numbers."""
    known = COLMAP_OTHERS | {number: name for name, (number, _, _) in COLMAP_TERMS.items()}
    models = pycolmap.CameraModelId.__members__.items()
    its = {int(model): name for name, model in models if int(model) >= 0}
    assert its.items() <= known.items()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "can't be read"),
        ("1 2 3", "can't be read"),
        ("nan 0 320 0 600 240 0 0 1", "can't be read"),
        ("600 0 320 0 -600 240 0 0 1", "focal length"),
        ("600 5 320 0 600 240 0 0 1", "no matrix"),
        ("600 0 900 0 600 240 0 0 1", "outside of the picture"),
        ("300 0 160 0 300 120 0 0 1", "the middle of a picture of 320x240 px"),
        ("675 675 360 270", "the middle of a picture of 720x540 px"),
        ("600 0 239 0 600 322 0 0 1", "the middle of a picture of 478x644 px"),
        ("600 600 320 240\n" * 4 + "900 900 320 240\n", "2 cameras that differ"),
        (
            "[LEFT]\nfx=600\nfy=600\ncx=320\ncy=240\n\n[RIGHT]\nfx=680\nfy=680\ncx=320\ncy=240",
            "2 cameras",
        ),
        ('{"cameraData": []}', "under a usual name, but cameraData)"),
        ("1 FISHEYE 640 480 600 320 240 0 0", "can't be read"),
        ("1 OPENCV_FISHEYE 640 480 600 600 320 240 0 0 0 0", "can't be read"),
        ("1 PINHOLE 640 480 600 320 240", "3 parameters"),
        ("1 PINHOLE 640 640 600 600 320 320", "for a picture of 640x640 px"),
        ("1 PINHOLE 640 480 600 600 320 240\n2 PINHOLE 640 480 9 9 320 240", "2 cameras"),
        ("1 OPENCV 640 480 600 600 320 240 0.1 0 0.003 0.003", "beyond k1 and k2"),
        (
            "camera_matrix: [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\n"
            "dist_coeffs: [[0, 0, 0, 0, 2.0]]\nimage_size: [640, 480]",
            "beyond k1 and k2",
        ),
        ('{"w": 640, "h": 480}', "can't be read"),
        ("[1, 2", "can't be read"),
        ("%YAML:1.0\n---\ncamera_matrix: 3\n", "can't be read"),
    ],
)
def test_what_is_no_calibration_of_these_frames_is_refused(tmp_path, text, said):
    path = text_file(tmp_path, "cameras.txt", text)
    with pytest.raises(BadIntrinsics, match=r"cameras\.txt.*; ") as error:
        read_intrinsics(path, SIZE_PX)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("terms", "radial"),
    [
        ((-0.2, 0.25, 0.0, 0.0, 0.0), (-0.2, 0.25)),
        ((-0.2, 0.005, 0.0, 0.0, 0.0), (-0.2, 0.0)),  # moves the corner by 0.4 px
        ((-0.207, 0.248, -0.0014, -0.001, 0.0), (-0.207, 0.248)),
        ((0.1, -0.2, 0.0, 0.0, 0.05), None),
    ],
)
def test_a_usual_calibration_has_two_terms(tmp_path, terms, radial):
    """As OpenCV and Human3.6M give it; a third is said by two."""
    matrix = "camera_matrix: {rows: 3, cols: 3, data: [600, 0, 320, 0, 600, 240, 0, 0, 1]}\n"
    bend = f"distortion_coefficients: {{rows: 1, cols: 5, data: {list(terms)}}}\n"
    text = f"image_width: 640\nimage_height: 480\n{matrix}{bend}"
    lens = read_intrinsics(text_file(tmp_path, "lens.yaml", text), SIZE_PX)
    assert radial is None or lens.radial == pytest.approx(radial, abs=1e-9)
    r = np.linspace(0, lens.corner_radius, 30)
    wanted_px, found_px = (
        600 * (k1 * r**3 + k2 * r**5 + k3 * r**7)
        for k1, k2, k3 in ((*terms[:2], terms[4]), (*lens.radial, 0.0))
    )
    assert np.abs(found_px - wanted_px).max() < 1.0


def test_a_cut_off_file_and_none_are_refused(tmp_path):
    path = tmp_path / "cameras.bin"
    for content in (b"", b"\x01", struct.pack("<QIiQQ", 1, 1, 1, 640, 480) + b"\0" * 9):
        path.write_bytes(content)
        with pytest.raises(BadIntrinsics, match="can't be read"):
            read_intrinsics(path, SIZE_PX)
    with pytest.raises(MissingInput, match="no such file"):
        read_intrinsics(tmp_path / "none.txt", SIZE_PX)


def jpeg_with(folder: Path, tags: dict[int, object]) -> Path:
    from PIL import Image

    image, path = Image.new("RGB", SIZE_PX), folder / "00000.jpg"
    exif = image.getexif()
    exif.get_ifd(0x8769).update(tags)
    image.save(path, exif=exif)
    return path


def test_exif_gives_the_focal_length_on_film_or_on_the_sensor(tmp_path):
    from PIL.TiffImagePlugin import IFDRational

    def noted(tags: dict[int, object]) -> Lens | None:
        return exif_lens(jpeg_with(tmp_path, tags), SIZE_PX)

    film = noted({0xA405: 26})
    assert film is not None and film.focal_px[0] == pytest.approx(26 / 43.267 * 800, rel=1e-4)
    assert (film.centre_px, film.radial, film.focal_from.source) == ((320, 240), (0, 0), "metadata")
    sensor = {0x920A: IFDRational(17, 4), 0xA20E: IFDRational(5000, 1), 0xA210: 3, 0xA002: 1280}
    # 4.25 mm at 500 px/mm are 2125 px of a picture that is twice as wide as the frames.
    lens = noted(sensor)
    assert lens is not None and lens.focal_px == pytest.approx((1062.5, 1062.5), rel=1e-3)
    upright = sensor | {0xA002: 960, 0xA003: 1280}
    assert noted(upright) == lens
    nothing = ({0x920A: IFDRational(17, 4)}, {0xA405: 0}, sensor | {0xA20E: IFDRational(1, 0)})
    assert [noted(tags) for tags in nothing] == [None] * 3
    path = jpeg_with(tmp_path, {0xA405: 26})
    content = path.read_bytes()
    at = content.index(b"Exif\0\0")
    for cut in range(6, 60, 3):
        path.write_bytes(content[: at + cut] + b"\xff" * 40)
        assert exif_lens(path, SIZE_PX) in (None, film)


def test_a_phones_video_gives_it_too(tmp_path):
    import av

    path = tmp_path / "phone.mov"
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as file:
        file.metadata["com.apple.quicktime.camera.focal_length.35mm_equivalent"] = "26"
        stream = file.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for packet in stream.encode(av.VideoFrame(64, 48, "yuv420p")):
            file.mux(packet)
        for packet in stream.encode():
            file.mux(packet)
    lens = video_lens(path, (64, 48))
    assert lens is not None and lens.focal_px[0] == pytest.approx(26 / 43.267 * 80, rel=1e-4)
    path.write_bytes(b"no video")
    assert video_lens(path, (64, 48)) is None
