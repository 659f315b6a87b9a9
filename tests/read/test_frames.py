"""Image folders: order, and every way in which frames can be unusable."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.read.frames import (
    check_images,
    decoded,
    exif_orientation,
    image_number,
    is_turned,
    list_images,
    read_color,
    read_gray,
    write_gray,
    write_image,
)
from gmrdata.values.errors import BadFrames, MissingInput


def put(folder: Path, *names: str, size_px: tuple[int, int] = (40, 30)) -> list[Path]:
    """Write noise images of a size (width, height)."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (size_px[1], size_px[0], 3)).astype(np.uint8)
    for name in names:
        assert cv2.imwrite(str(folder / name), image)
    return [folder / name for name in names]


def test_frames_come_in_the_order_of_their_numbers(tmp_path):
    put(tmp_path, "image_10.jpg", "image_9.jpg", "image_8.png", "image_11.jpeg")
    (tmp_path / "notes.txt").write_text("12")
    names = [path.name for path in list_images(tmp_path)]
    assert names == ["image_8.png", "image_9.jpg", "image_10.jpg", "image_11.jpeg"]
    assert check_images(list_images(tmp_path)) == (40, 30)


@given(st.integers(0, 10**8), st.sampled_from(["image_", "", "seq2_cam03-", "a.b"]))
def test_the_number_is_the_last_one_in_the_name(number, prefix):
    assert image_number(Path(f"clip/{prefix}{number:05d}.jpg")) == number


@given(
    width=st.integers(1, 300), height=st.integers(1, 300), suffix=st.sampled_from([".jpg", ".png"])
)
def test_header_sizes_are_what_opencv_decodes(width, height, suffix, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / f"0{suffix}"
    cv2.imwrite(str(path), np.zeros((height, width, 3), np.uint8))
    assert check_images([path]) == (width, height)


THUMBNAIL = b"\xff\xe1" + (1000).to_bytes(2, "big") + b"\xff\xc0" * 499


@pytest.mark.parametrize("more", [THUMBNAIL, b"\xff\xff"], ids=["metadata", "fill bytes"])
def test_a_jpeg_with_more_before_its_header_is_read(more, tmp_path):
    (path,) = put(tmp_path, "0.jpg")
    plain = path.read_bytes()
    path.write_bytes(plain[:2] + more + plain[2:])
    assert check_images([path]) == (40, 30)


def with_exif(path: Path, orientation: int, order: str = "MM") -> Path:
    """Put an EXIF orientation into a JPEG or PNG."""
    mark = ">" if order == "MM" else "<"
    entry = struct.pack(mark + "HHIHH", 0x112, 3, 1, orientation, 0)
    tiff = order.encode() + struct.pack(mark + "HIH", 42, 8, 1) + entry + bytes(4)
    content = path.read_bytes()
    if path.suffix == ".png":
        body = b"eXIf" + tiff
        segment = struct.pack(">I", len(tiff)) + body + struct.pack(">I", zlib.crc32(body))
        path.write_bytes(content[:33] + segment + content[33:])
    else:
        segment = b"\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff
        path.write_bytes(content[:2] + segment + content[2:])
    return path


@pytest.mark.parametrize("order", ["MM", "II"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_each_reader_turns_by_exif_as_viewers_do(tmp_path, orientation, order):
    """OpenCV's and Pillow's own turning are the oracles; PNG and JPEG have one rule."""
    from PIL import Image, ImageOps

    (jpeg, png) = put(tmp_path, "0.jpg", "1.png")
    stored = cv2.imread(str(png))
    shown = np.asarray(ImageOps.exif_transpose(Image.open(with_exif(png, orientation, order))))
    assert np.array_equal(read_color(png), shown[..., ::-1])
    with_exif(jpeg, orientation, order)
    assert np.array_equal(read_color(jpeg), cv2.imread(str(jpeg), cv2.IMREAD_COLOR))
    assert np.array_equal(read_gray(jpeg), cv2.imread(str(jpeg), cv2.IMREAD_GRAYSCALE))
    size_px = (40, 30) if orientation <= 4 else (30, 40)
    assert check_images([jpeg, png]) == size_px
    assert read_gray(jpeg, size_px).shape == size_px[::-1]
    unchanged = decoded(png, cv2.IMREAD_UNCHANGED, "fault")
    assert np.array_equal(unchanged, read_color(png)) and stored.shape == (30, 40, 3)
    assert is_turned(jpeg) == is_turned(png) == (orientation != 1)


@given(st.binary(max_size=60))
def test_exif_that_is_nonsense_is_upright_or_turned(tail):
    for tiff in (b"MM\0*" + tail, b"II*\0" + tail, tail):
        length = (len(tiff) + 8).to_bytes(2, "big")
        jpeg = b"\xff\xd8\xff\xe1" + length + b"Exif\0\0" + tiff
        assert 1 <= exif_orientation(jpeg) <= 8
        assert 1 <= exif_orientation(jpeg[: len(jpeg) // 2]) <= 8


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("frame0001_180x240.jpg", 1),
        ("0012@2x.png", 12),
        ("0012_1080p.png", 12),
        ("00012_640px_30fps.jpg", 12),
        ("1920x1080_00012.jpg", 12),
        ("frame-000012.color.png", 12),
        ("cam2x10.jpg", 10),
        ("shot720p.png", 720),
        ("IMG_20240101_0003.jpg", 3),
    ],
)
def test_a_size_in_the_name_is_no_number_of_a_frame(name, number):
    """It is where the name has no other number."""
    assert image_number(Path(name)) == number


def test_what_macos_puts_beside_files_is_left_out(tmp_path):
    put(tmp_path, "frame0001_18x24.jpg", "frame0002_18x24.jpg")
    for name in ("._frame0001_18x24.jpg", "._frame0003_18x24.jpg", ".DS_Store"):
        (tmp_path / name).write_bytes(b"\0\5\x16\7")
    assert [path.name[:9] for path in list_images(tmp_path)] == ["frame0001", "frame0002"]


def test_an_image_whose_name_is_no_text_is_named(tmp_path):
    put(tmp_path, "1.jpg", "2.jpg")
    (tmp_path / "2.jpg").rename(tmp_path / "caf\udce9_2.jpg")
    with pytest.raises(BadFrames, match=r"caf\\xe9_2\.jpg: .*Rename it"):
        list_images(tmp_path)


def test_a_missing_folder_and_no_images(tmp_path):
    with pytest.raises(MissingInput, match="no such folder of images"):
        list_images(tmp_path / "nothing")
    with pytest.raises(BadFrames, match="at least 2 frames"):
        check_images([])


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["0.jpg"], "1 image.*at least 2"),
        (["1.png", f"{'1' * 12}.png"], "more than 9 digits; name frames like"),
        (["1.png", f"{'9' * 200}.png"], "more than 9 digits; name frames like"),
        (["0.jpg", "1.jpg", "3.jpg"], "frame 2 missing between 1 and 3"),
        (["00.jpg", "09.jpg"], "frame 1 to 8 missing between 0 and 9"),
        (["1.jpg", "1.png", "2.jpg"], r"two images have the number 1, 1\.jpg and 1\.png; name fr"),
        (["a.jpg", "1.jpg"], "a.jpg: no number in the name"),
    ],
)
def test_numbers_that_do_not_run_through(names, said, tmp_path):
    put(tmp_path, *names)
    with pytest.raises(BadFrames, match=said):
        list_images(tmp_path)


def test_left_out_numbers_are_not_listed_and_not_missed(tmp_path):
    put(tmp_path, "1.jpg", "2.jpg", "4.jpg", "5.jpg", "5.png", "8.jpg")
    left_out = {3, 5, 6, 7, 99}
    names = [path.name for path in list_images(tmp_path, left_out)]
    assert names == ["1.jpg", "2.jpg", "4.jpg", "8.jpg"]
    with pytest.raises(BadFrames, match="frame 6 missing between 4 and 8"):
        list_images(tmp_path, left_out - {6})
    with pytest.raises(BadFrames, match="two images have the number 5"):
        list_images(tmp_path, left_out - {5})
    with pytest.raises(BadFrames, match=r"1 image\(s\) but 4 left out; at least 2"):
        list_images(tmp_path, (1, 2, 4, 5))


def test_one_frame_of_another_size_is_named(tmp_path):
    paths = put(tmp_path, "1.jpg", "2.jpg") + put(tmp_path, "0.png", size_px=(30, 40))
    with pytest.raises(BadFrames, match=r"0\.png: 30x40 px, other frames are 40x30 px"):
        check_images(sorted(paths))


NO_IMAGE = "truncated or not an image"


@pytest.mark.parametrize(
    ("suffix", "damaged", "said"),
    [
        (".jpg", lambda whole: whole[:-200], NO_IMAGE),
        (".png", lambda whole: whole[:-200], NO_IMAGE),
        (".jpg", lambda _: b"hello, not an image", NO_IMAGE),
        (".jpg", lambda _: b"\xff\xd8\xff\xd9", NO_IMAGE),
        (".jpg", lambda _: b"\x89PNG\r\n", NO_IMAGE),
        (".jpg", lambda _: b"", "empty file"),
    ],
)
def test_broken_frames_are_named(suffix, damaged, said, tmp_path):
    paths = put(tmp_path, f"0{suffix}", f"1{suffix}")
    paths[1].write_bytes(damaged(paths[1].read_bytes()))
    with pytest.raises(BadFrames, match=rf"1\{suffix}: {said}"):
        check_images(paths)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_frame_may_have_a_film_behind_it_and_a_small_picture_in_its_head(suffix, tmp_path):
    """As phones write them; such frames were called truncated."""
    (path,) = put(tmp_path, f"0{suffix}")
    small, whole = path.read_bytes(), path.read_bytes()
    if suffix == ".jpg":  # in its EXIF
        part = b"Exif\0\0" + small
        whole = whole[:2] + b"\xff\xe1" + struct.pack(">H", len(part) + 2) + part + whole[2:]
    path.write_bytes(whole + b"\0\0\0\x18ftyp" + bytes(9999))
    assert check_images([path]) == (40, 30)
    path.write_bytes(whole[:-100])
    with pytest.raises(BadFrames, match=NO_IMAGE):
        check_images([path])


@given(
    content=st.binary(max_size=200),
    start=st.sampled_from([b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b""]),
)
def test_random_bytes_never_crash_the_check(content, start, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "0.jpg"
    path.write_bytes(start + content)
    try:
        width, height = check_images([path])
    except BadFrames:
        return
    assert width > 0 and height > 0


def test_gray_images_are_read_back_as_written(tmp_path):
    mask = np.random.default_rng(1).integers(0, 255, (12, 17)).astype(np.uint8)
    write_gray(tmp_path / "m.png", mask)
    assert np.array_equal(read_gray(tmp_path / "m.png", (17, 12)), mask)
    assert [p.name for p in tmp_path.iterdir()] == ["m.png"]
    with pytest.raises(BadFrames, match="17x12 px, its frame is 12x17 px"):
        read_gray(tmp_path / "m.png", (12, 17))
    with pytest.raises(BadFrames, match="missing or not an image"):
        read_gray(tmp_path / "other.png")


def test_rows_of_masks_are_not_filtered(tmp_path):
    """Filtered ones took seven times as long to read, and masks are read ten times and more."""
    write_gray(tmp_path / "m.png", np.pad(np.full((20, 30), 255, np.uint8), 40))
    content = (tmp_path / "m.png").read_bytes()
    at, data = 8, b""
    while at < len(content):
        length, kind = int.from_bytes(content[at : at + 4]), content[at + 4 : at + 8]
        data += content[at + 8 : at + 8 + length] if kind == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(data), np.uint8).reshape(100, 111)
    assert not rows[:, 0].any()


def png_header(width: int, height: int) -> bytes:
    """A PNG that claims a size, with its end and no pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = [header, b"IDAT" + zlib.compress(bytes(1000)), b"IEND"]
    sized = (struct.pack(">I", len(one) - 4) + one for one in chunks)
    summed = zip(sized, (struct.pack(">I", zlib.crc32(one)) for one in chunks), strict=True)
    return b"\x89PNG\r\n\x1a\n" + b"".join(one + crc for one, crc in summed)


@pytest.mark.parametrize("size_px", [(30_000, 30_000), (2**31 - 1, 2**31 - 1), (2**31 - 1, 1)])
def test_a_header_that_claims_any_size_takes_no_memory(size_px, tmp_path):
    whole = png_header(*size_px)
    for name, content in (("0.png", whole), ("1.png", whole[:60])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BadFrames, match=rf"{name}: [0-9]+x[0-9]+ px, more than 200000000"):
            read_gray(tmp_path / name)
    with pytest.raises(BadFrames, match=r"0\.png: .* make the image smaller"):
        check_images([tmp_path / "0.png"])


def test_pictures_of_other_kinds_are_not_decoded(tmp_path):
    """OpenCV tells them by their content; what a header of theirs claims is not known here."""
    put(tmp_path, "0.bmp")
    (tmp_path / "0.bmp").rename(tmp_path / "0.png")
    with pytest.raises(BadFrames, match=r"0\.png: missing or not an image"):
        read_gray(tmp_path / "0.png")


def test_a_gap_of_a_billion_numbers_is_said_at_once(tmp_path):
    put(tmp_path, "1.png", "000000999999999.png")
    with pytest.raises(BadFrames, match="frame 4 to 999999998 missing between 1 and 999999999"):
        list_images(tmp_path, left_out={2, 3, 7})


def test_a_path_whose_bytes_are_no_text_is_read_and_written(tmp_path):
    folder = tmp_path / "caf\udce9"
    folder.mkdir()
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    write_image(folder / "00001.png", image)
    np.testing.assert_array_equal(read_color(folder / "00001.png"), image)
    (plain := tmp_path / "plain.png").write_bytes((folder / "00001.png").read_bytes())
    np.testing.assert_array_equal(cv2.imread(str(plain)), image)
