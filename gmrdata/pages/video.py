"""The page of one solved video: the verdict first, then what was found, and files to take along."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np

from gmrdata.pages import solved_sections as sections
from gmrdata.pages import thresholds
from gmrdata.pages.footage import (
    BAR_BGR,
    Footage,
    footage_picture,
    shown_rows,
    write_footage,
)
from gmrdata.pages.frames import jpeg
from gmrdata.pages.html import Table, render
from gmrdata.pages.video_data import SolvedVideo, footage_of, gather_video
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.files import STAGE_FILE, remove_orphans, write_bytes, write_text
from gmrdata.values.people import FUSED, PSEUDO_GT, person_file
from gmrdata.values.records import Config
from gmrdata.write.overlay import OVERLAY_BGR

PAGE_FILE = "index.html"
OVERLAY, OVERLAY_FILE, POSTER_FILE = "overlay", "overlay.mp4", "poster.jpg"
FILES = "files"
MOST_LINKS = 12  # of one format; more are folded
RECORDS = {
    "frames": ("video.json",),
    "masks": ("masks.json",),
    "bodies": ("bodies.json",),
    "intrinsics": ("intrinsics.json",),
    "sfm": ("quality.json",),
    PSEUDO_GT: ("quality.json",),
    FUSED: ("fusion.json",),
}
"""What the stages leave for people to read, beside their records."""


class Download(NamedTuple):
    """A format that may lie in the folder `files`, and what it is for."""

    format: str
    name: str
    use: str


DOWNLOADS = (
    Download("bvh", "BVH", "the motion for Blender, MotionBuilder and game engines: Mixamo's "
             "joints, in cm, a file for each unbroken stretch"),
    Download("glb", "GLB", "the body with its skin and the camera, animated, for Blender and "
             "browsers"),
    Download("amass", "AMASS npz", "the motion for training code: SMPL+H's keys, a file for each "
             "unbroken stretch"),
    Download("colmap", "COLMAP", "cameras and points for COLMAP, Gaussian splatting and NeRFs, "
             "binary and text"),
    Download("tum", "TUM", "the camera's path as text: time, place, quaternion; for evo"),
)  # fmt: skip
GIVEN_AS_IT_IS = "given, and kept as it is"
SOURCES = {
    "given": "given",
    "metadata": "the camera’s own note in the file",
    "self_calibrated": "found in the frames",
    "prior": "a guess by what is usual: nothing says",
}
CLIP_USE = (
    "the world motion and the camera as gmrdata keeps them: AMASS's keys, a row for each frame"
)
SIGMA_USE = "one standard deviation of place [m] and turn [°] in each frame"
CAMERAS_USE = "the same motion by the cameras alone, in the frames that are kept"
Offer = tuple[str, str, list[tuple[str, str, str]]]
"""Name and use of files, and the address, the name and the size of each."""


class OverlayConfig(Config):
    """What decides the overlay besides the files that it shows."""

    version: int = 1


def make_video_page(
    out_dir: Path,
    *,
    images_dir: Path | None = None,
    body: str | None = None,
    left_out: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write `index.html` and `overlay/` of a solved video, with links to what lies beside them.

    What was made before and did not change is kept.  A file that is missing, or broken, costs its
    part and not the page; the page says what is missing.

    Args:
        out_dir: Folder of `gmrdata video`, of `gmrdata sfm`, or of one sequence of
            `gmrdata threedpw regenerate`: sfm/ and pseudo_gt/, or sfm/ alone.
        images_dir: The frames, where they are not in `out_dir/frames`.
        body: The people's body, as `load_body` takes it, or a folder of bodies; what lies beside
            the clips when None.
        left_out: Formats of `files` that could not be written, with the reasons.

    Raises:
        MissingInput: `out_dir` holds neither.
    """
    out_dir = out_dir.resolve()
    found = gather_video(out_dir, images_dir, body)
    remove_orphans(out_dir)
    page = render(
        "video", found=found, title=_text(found.name), lead=_lead(found),
        sections=sections.made(_makers(found, left_out)), colours=_colours(),
    )  # fmt: skip
    write_text(out_dir / PAGE_FILE, _text(page))
    return out_dir / PAGE_FILE


def _makers(
    found: SolvedVideo, left_out: Sequence[tuple[str, str]]
) -> dict[str, Callable[[], object]]:
    """What makes each section that there is something for, in their order."""
    makers: dict[str, Callable[[], object]] = {
        "verdict": lambda: _judged_by(found),
        "overlay": lambda: _overlay(found),
    }
    record, cameras = found.record, found.cameras
    if found.world_from_cam is not None and cameras is not None:
        makers["paths"] = lambda: sections.paths(found)
    if found.fused is not None:
        makers["fused"] = lambda: _fused(found)
    if found.reasons:
        makers["over_time"] = lambda: sections.over_time(found, found.config.verdict)
    if record is not None and record.cameras is not None:
        makers["scale"] = lambda: sections.scale_cues(record)
    if found.camera is not None:
        makers["lens"] = lambda: _lens(found)
    makers["downloads"] = lambda: _downloads(found, left_out)
    if record is not None and record.cameras is not None:
        makers["camera_class"] = lambda: sections.camera_class(record, found.config.motion_class)
    if cameras is not None:
        rows = sections.reconstruction_rows(cameras, with_lens=False)
        makers["reconstruction"] = lambda: rows
    return makers | {"files": lambda: _files(found)}


def _text(text: str) -> str:
    """Bytes of file names that are no text stand in it as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _lead(found: SolvedVideo) -> str:
    parts = []
    if (camera := found.camera) is not None:
        parts.append(f"{camera.width_px}×{camera.height_px} px")
    if found.n_frames:
        parts.append(f"{found.n_frames} frames")
    if len(found.times_s) > 1:
        parts.append(f"{found.times_s[-1] - found.times_s[0]:.1f} s")
    if n_people := len(found.judged):
        parts.append(f"{n_people} people" if n_people > 1 else "one person")
    elif found.camera_verdict is not None:
        parts.append("cameras alone")
    if found.record is not None and found.is_solved:
        parts.append(f"{found.record.camera_motion.replace('_', ' + ')} camera")
    return ", ".join(parts)


def _judged_by(found: SolvedVideo) -> list[Table]:
    """The figures behind the verdict."""
    if not found.is_solved:
        return []
    config = found.config.verdict
    rows = thresholds.camera_rows(found.cameras, config)
    if not found.is_alone:
        rows = thresholds.verdict_rows(found, found.config)
    whole = thresholds.threshold_table(rows, "threshold", "What the video was judged by.")
    if found.is_alone:
        return [whole]
    worst = "The worst of all frames or steps between them; those beyond a threshold are dropped."
    frames = thresholds.frame_rows(found, config)
    return [whole, thresholds.threshold_table(frames, "threshold", worst)]


def _overlay(found: SolvedVideo) -> dict[str, object]:
    """Make the overlay, if it is not there, and say what stands beside it."""
    footage = footage_of(found)
    folder = make_overlay(found, footage)
    rows, rate_hz = shown_rows(footage.times_s, footage.fps_hz)
    video = folder / OVERLAY_FILE
    return {
        "video": quote(f"{OVERLAY}/{OVERLAY_FILE}"),
        "poster": quote(f"{OVERLAY}/{POSTER_FILE}"),
        "size_mb": video.stat().st_size / 1e6,
        "every": max(1, round(footage.fps_hz / rate_hz)),
        "has_masks": any(footage.masks),
        "is_fused": found.is_fused,
        "without_camera": int((~footage.camera.has_camera).sum()),
        "people": [one.id for one in found.people],
        "marks": found.is_alone and _marks_words(found, footage),
        "n_pictures": len(rows),
    }


def _marks_words(found: SolvedVideo, footage: Footage) -> str:
    if not len(footage.marks.world_m):
        return ""
    solved = found.reconstruction
    if solved is not None and solved.cameras.geometry == "full":
        return "background points that the cameras were found with"
    return "a grid of directions, 10° apart"


def make_overlay(found: SolvedVideo, footage: Footage) -> Path:
    """Stage: `overlay.mp4` and `poster.jpg`, made anew when anything that they show changed."""

    def work(partial: Path) -> None:
        write_footage(partial / OVERLAY_FILE, footage)
        there = np.array([image is not None for image in footage.images])
        drawn = there & footage.camera.has_camera
        rows = np.flatnonzero(drawn if drawn.any() else there)
        middle = int(rows[len(rows) // 2])
        write_bytes(partial / POSTER_FILE, jpeg(footage_picture(footage, middle), 80))

    images = (path.parent for path in footage.images if path is not None)
    inputs = {"images": next(images)}
    inputs |= {name: found.folder / name for name in ("masks", "sfm", PSEUDO_GT, FUSED)}
    inputs = {name: path for name, path in inputs.items() if path.is_dir()}
    out_dir = found.folder / OVERLAY
    return run_stage(OVERLAY, out_dir, OverlayConfig(), inputs, work, run=Run(redo=True))


def _fused(found: SolvedVideo) -> dict[str, object]:
    from gmrdata.pages.fusion import fused_shown

    assert found.fused is not None
    return fused_shown(found.fused)


def _colours() -> dict[str, str]:
    def css(bgr: tuple[int, int, int]) -> str:
        return "rgb({2} {1} {0})".format(*bgr)

    return {name: css(bgr) for name, bgr in (OVERLAY_BGR | BAR_BGR).items()}


def _lens(found: SolvedVideo) -> dict[str, object]:
    """The intrinsics, where they came from, and how well they are known."""
    camera, lens = found.camera, found.intrinsics
    assert camera is not None
    focal_px, centre_px = np.diag(camera.intrinsics_px)[:2], camera.intrinsics_px[:2, 2]
    numbers = dict.fromkeys(f"{one:.1f}" for one in focal_px.tolist())
    error = "" if lens is None else f" ± {100 * lens.focal_sigma:.2g} %"
    rows: list[tuple[str, object]] = [
        ("Focal length", f"{' and '.join(numbers)} px{error}"),
        ("Field of view", _field_of_view(camera)),
        ("Principal point", "{:.1f}, {:.1f} px".format(*centre_px.tolist())),
        ("Picture", f"{camera.width_px}×{camera.height_px} px"),
        ("Where it comes from", GIVEN_AS_IT_IS if lens is None else SOURCES[lens.source]),
    ]
    if lens is not None and (lens.radial_k1 or lens.radial_k1_sigma is not None):
        spread = "" if lens.radial_k1_sigma is None else f" ± {lens.radial_k1_sigma:.2g}"
        rows.append(("Radial distortion k1", f"{lens.radial_k1:.4g}{spread}"))
    if found.cameras is not None:
        rows += found.cameras.lens_in_words
    objections, notes = ((), ()) if lens is None else (lens.objections, lens.notes)
    return {"rows": rows, "objections": objections, "notes": notes}


def _field_of_view(camera: CameraPath) -> str:
    sides_px = np.array([camera.width_px, camera.height_px])
    focal_px, centre_px = np.diag(camera.intrinsics_px)[:2], camera.intrinsics_px[:2, 2]
    angles = np.arctan(centre_px / focal_px) + np.arctan((sides_px - centre_px) / focal_px)
    wide_deg, high_deg = np.rad2deg(angles)
    return f"{wide_deg:.1f}° by {high_deg:.1f}°"


def _downloads(found: SolvedVideo, left_out: Sequence[tuple[str, str]]) -> dict[str, object]:
    """What lies in `files`, by format, what the stages keep of people, and what could not be
    written."""
    own, exported = list(_own_files(found)), []
    for download in DOWNLOADS:
        folder = found.folder / FILES / download.format
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        exported.append((download.name, download.use, list(_links(found.folder, files, folder))))
    return {
        "offers": [offer for offer in (*own, *exported) if offer[-1]],
        "exported": any(links for *_, links in exported),
        "left_out": left_out,
        "most": MOST_LINKS,
    }


def _own_files(found: SolvedVideo) -> Iterator[Offer]:
    """Name, use and links of what the stages keep of people."""

    def offer(name: str, use: str, stage: str, file: Callable[[int], str]) -> Offer:
        paths = [found.folder / stage / file(person) for person in range(len(found.judged))]
        return name, use, list(_links(found.folder, paths, found.folder / stage))

    if not found.is_fused:
        yield offer("gmrdata npz", CLIP_USE, PSEUDO_GT, person_file)
        return
    from gmrdata.fusion.fused_motion import sigma_file

    yield offer("gmrdata npz", CLIP_USE, FUSED, person_file)
    yield offer("Error bars, npz", SIGMA_USE, FUSED, sigma_file)
    yield offer("Pseudo ground truth, npz", CAMERAS_USE, PSEUDO_GT, person_file)


def _links(root: Path, files: Sequence[Path], below: Path) -> Iterator[tuple[str, str, str]]:
    """Address, path below a folder, and size of each file that does lie in the root."""
    for path in files:
        if path.is_file() and path.resolve().is_relative_to(root):
            size = path.stat().st_size
            said = f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
            # Names whose bytes are no text are addressed by their bytes.
            href = quote(path.relative_to(root).as_posix(), errors="surrogateescape")
            yield href, _text(path.relative_to(below).as_posix()), said


def _files(found: SolvedVideo) -> list[tuple[str, list[tuple[str, str]]]]:
    """Links to the records of the stages."""
    stages = []
    for stage, names in RECORDS.items():
        folder = found.folder / stage
        there = [name for name in (STAGE_FILE, *names) if (folder / name).is_file()]
        if there:
            stages.append((stage, [(quote(f"{stage}/{name}"), name) for name in there]))
    return stages
