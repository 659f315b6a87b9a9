"""The page of a solved sequence: the verdict first, then what was found, and files to take along.

A video, cameras alone and a sequence of 3DPW share it: a section stands where there is something to
show.  What `solved.html.j2` takes is made here.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from gmrdata.cameras.files import CamerasQuality
from gmrdata.cameras.lens.intrinsics import beside_cameras
from gmrdata.motion.resample import valid_runs
from gmrdata.pages import solved_plots, thresholds
from gmrdata.pages.footage import (
    BAR_BGR,
    Footage,
    footage_of,
    footage_picture,
    shown_rows,
    write_footage,
)
from gmrdata.pages.frames import jpeg
from gmrdata.pages.gather import PEOPLE, gather_video
from gmrdata.pages.html import Cell, Table, css_colours, render, text_of, write_page
from gmrdata.pages.plots import svg
from gmrdata.pages.report import GEOMETRY_WORDS
from gmrdata.pages.report_data import NO_FIGURE
from gmrdata.pages.solved import SolvedSequence, align_dataset_camera, counts_of
from gmrdata.pages.view3d import MOST_BODIES, view_of, write_view
from gmrdata.solve.request import FRAMES, INTRINSICS, LINES, MASKS, SFM
from gmrdata.solve.verdict import FILES, OVERLAY, PAGE, VIEW
from gmrdata.stage.run import Run
from gmrdata.stage.store import run_stage
from gmrdata.values.camera import CameraPath
from gmrdata.values.camera_motion import MotionClassConfig
from gmrdata.values.clip import dropped_ranges
from gmrdata.values.errors import GmrdataError
from gmrdata.values.files import STAGE_FILE, remove_orphans, write_bytes
from gmrdata.values.people import BODIES, FUSED, PSEUDO_GT, person_file
from gmrdata.values.records import Config
from gmrdata.world.judge import PseudoGtQuality
from gmrdata.write.overlay import OVERLAY_BGR

OVERLAY_FILE, POSTER_FILE = "overlay.mp4", "poster.jpg"
VIEWS = "view3d"
MOST_LINKS = 12  # of one format; more are folded
OPEN_RANGES = 12  # a longer list of dropped ranges is folded
RECORDS = {
    FRAMES: ("video.json",),
    PEOPLE: ("people.json", "doubts.json"),
    MASKS: ("masks.json",),
    BODIES: ("bodies.json",),
    INTRINSICS: ("intrinsics.json",),
    SFM: ("quality.json",),
    LINES: (),
    PSEUDO_GT: ("quality.json",),
    FUSED: ("fusion.json",),
}
"""What the stages leave for people to read, beside their records."""
OF_THREEDPW = PEOPLE, MASKS, SFM, LINES, PSEUDO_GT
"""Those that each of its sequences goes through."""


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
    "prior": "a guess: neither the file nor the camera’s motion tells",
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

    version: int = 2
    people: tuple[str, ...]
    """Whose body is at hand."""
    dropped: tuple[tuple[int, int], ...]
    """Ranges of frames that are not kept, as the verdict has them."""
    fps_hz: float
    """The rate at which they are shown."""


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
    sequence = gather_video(out_dir, images_dir, body)
    remove_orphans(out_dir)
    page = out_dir / PAGE
    write_page(page, solved_page(sequence, page, left_out=left_out))
    return page


Strips = Sequence[Sequence[tuple[object, object]]]
"""Two rows of frames, each a `Kind` or None and a `Tile`; the second is of dropped frames."""


def solved_page(
    solved: SolvedSequence,
    page: Path,
    *,
    left_out: Sequence[tuple[str, str]] = (),
    strips: Strips | None = None,
    links: Sequence[tuple[str, str]] = (),
    failure: str = "",
) -> str:
    """The page as HTML; the same sequence gives the same bytes.

    Args:
        page: Where the page will lie, from which its links lead; its view in 3D lies beside it.
        left_out: Formats of `files` that could not be written, with the reasons.
        strips: Frames to show where none are drawn over.
        links: Other pages.
        failure: Address of the whole message of a failure.
    """
    makers = list(_makers(solved, left_out, lambda: _view(solved, page)))
    if strips is not None:
        makers.append(("frames", lambda: strips))
    makers.append(("files", lambda: {"stages": _stages(solved, page.parent), "failure": failure}))
    sections: list[tuple[str, object, str]] = []
    for kind, make in makers:
        try:
            sections.append((kind, make(), ""))
        except (GmrdataError, OSError) as error:  # what can't be shown must not cost the others
            sections.append((kind, None, str(error)))
    return render(
        "solved", solved=solved, title=text_of(solved.name), lead=_lead(solved), sections=sections,
        colours=css_colours(OVERLAY_BGR | BAR_BGR), links=list(links),
    )  # fmt: skip


def _makers(
    solved: SolvedSequence, left_out: Sequence[tuple[str, str]], view: Callable[[], object]
) -> Iterator[tuple[str, Callable[[], object]]]:
    """What makes each section that there is something for, in their order."""
    record, cameras, by_video = solved.record, solved.cameras, solved.dataset is None
    yield "verdict", partial(_judged_by, solved)
    if by_video:
        yield "overlay", partial(_overlay, solved)
    # Where people were judged, that their motions can't be read is said there.
    if solved.is_solved and (solved.camera is not None or not solved.is_alone):
        yield "view3d", view
        yield "paths", partial(_paths, solved)
    if solved.fused is not None:
        from gmrdata.pages.fusion import fused_shown

        yield "fused", partial(fused_shown, solved.fused)
    if solved.reasons:
        yield "over_time", partial(_over_time, solved)
    if record is not None and record.cameras is not None:
        yield "scale", partial(_scale_cues, record)
    if solved.camera is not None:
        yield "lens", partial(_lens, solved, solved.camera)
    if by_video:
        yield "downloads", partial(_downloads, solved, left_out)
    if record is not None and record.cameras is not None:
        yield "camera_class", partial(_camera_class, record, solved.config.motion_class)
    if cameras is not None:
        yield "reconstruction", partial(_reconstruction_rows, cameras)


def _lead(solved: SolvedSequence) -> str:
    parts = [] if solved.dataset is None else [solved.dataset.verdict.split or "not read"]
    if (camera := solved.camera) is not None:
        parts.append(f"{camera.width_px}×{camera.height_px} px")
    if solved.n_frames:
        parts.append(f"{solved.n_frames} frames")
    if len(solved.times_s) > 1:
        parts.append(f"{solved.times_s[-1] - solved.times_s[0]:.1f} s")
    if n_people := 0 if solved.is_alone else len(solved.reasons):
        parts.append(f"{n_people} people" if n_people > 1 else "one person")
    elif solved.camera_verdict is not None:
        parts.append("cameras alone")
    if solved.record is not None and solved.is_solved:
        parts.append(f"{solved.record.camera_motion.replace('_', ' + ')} camera")
    return ", ".join(parts)


def _judged_by(solved: SolvedSequence) -> list[Table]:
    """The figures behind the verdict."""
    if not solved.is_solved:
        return []
    what = "sequence as a whole" if solved.dataset else "video"
    whole = thresholds.threshold_table(
        thresholds.verdict_rows(solved), "threshold", f"What the {what} was judged by."
    )
    if solved.is_alone:
        return [whole]
    worst = "The worst of all frames or steps between them; those beyond a threshold are dropped."
    frames = thresholds.frame_rows(solved)
    return [whole, thresholds.threshold_table(frames, "threshold", worst)]


def _overlay(solved: SolvedSequence) -> dict[str, object]:
    """Make the overlay, if it is not there, and say what stands beside it."""
    footage = footage_of(solved)
    folder = make_overlay(solved, footage)
    _, rate_hz = shown_rows(footage.times_s, footage.fps_hz)
    video = folder / OVERLAY_FILE
    return {
        "video": quote(f"{OVERLAY}/{OVERLAY_FILE}"),
        "poster": quote(f"{OVERLAY}/{POSTER_FILE}"),
        "size_mb": video.stat().st_size / 1e6,
        "every": max(1, round(footage.fps_hz / rate_hz)),
        "has_masks": any(footage.masks),
        "without_camera": int((~footage.camera.has_camera).sum()),
        "people": [one.id for one in solved.people],
        "marks": solved.is_alone and _marks_words(solved, footage),
        "fits": list(_fits_in_words(solved)),
        "is_off": bool(footage.off.any()),
    }


def _fits_in_words(solved: SolvedSequence) -> Iterator[str]:
    """How well each body lies on the person, in the frames that show both."""
    if solved.record is None:
        return
    for one, fit in zip(solved.record.people, solved.record.picture_fits, strict=True):
        if fit is None:
            yield f"{one.id}: not checked against the picture"
        else:
            yield (
                f"{one.id} lies on the person by {fit.overlap:.0%} (overlap of outlines, median of "
                f"{fit.frames} frames), beside it in {fit.off_frames}"
            )


def _view(solved: SolvedSequence, page: Path) -> dict[str, object]:
    """Write the world to turn round, and say what stands beside it."""
    view, file = view_of(solved), VIEW
    if page.name != PAGE:  # one of many in a folder
        file = f"{VIEWS}/{page.name}"
    written = write_view(page.parent / file, view)
    return {
        "href": quote(file),
        "size_mb": written.stat().st_size / 1e6,
        "bodies": sum(one.body is not None for one in view.people[:MOST_BODIES]),
        "people": len(view.people),
        "has_sigma": any(one.sigma_m is not None for one in view.people),
    }


def _marks_words(solved: SolvedSequence, footage: Footage) -> str:
    if not len(footage.marks.world_m):
        return ""
    if solved.reconstruction is not None and solved.reconstruction.cameras.geometry == "full":
        return "background points that the cameras were found with"
    return "a grid of directions, 10° apart"


def make_overlay(solved: SolvedSequence, footage: Footage) -> Path:
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
    folder = _folder(solved)
    inputs |= {name: folder / name for name in (MASKS, SFM, PSEUDO_GT, FUSED)}
    inputs = {name: path for name, path in inputs.items() if path.is_dir()}
    people = tuple(person.name for person in footage.people)
    dropped = tuple(valid_runs(footage.dropped))
    config = OverlayConfig(people=people, dropped=dropped, fps_hz=footage.fps_hz)
    return run_stage(OVERLAY, folder / OVERLAY, config, inputs, work, run=Run(anew=True))


def _folder(solved: SolvedSequence) -> Path:
    assert solved.folder is not None
    return solved.folder


def _over_time(solved: SolvedSequence) -> dict[str, object]:
    headings = ("of", "frames", "number", "reason")
    ranges, height_in = list(_ranges(solved)), solved_plots.height_in(solved)
    return {
        "plot": svg(lambda plot: solved_plots.plot_time(plot, solved), 11.0, height_in, "time"),
        "legend": list(_legend(solved)),
        "ranges": Table(headings, ranges, "Dropped ranges, as counted from 0 in the sequence."),
        "open": len(ranges) <= OPEN_RANGES,
    }


def _legend(solved: SolvedSequence) -> Iterator[tuple[str, str]]:
    accepted = solved.accepted
    with_kept = [i for i, reasons in enumerate(solved.reasons) if "" in reasons]
    if not solved.is_solved and with_kept:
        yield "var(--rule)", "the data set vouches for it"
    if solved.is_solved and any(accepted[i] for i in with_kept):
        yield "var(--good)", "kept"
    if solved.is_solved and not all(accepted[i] for i in with_kept):
        yield "var(--rule)", "within the thresholds, but rejected"
    for kind, n in counts_of(solved.reasons).items():
        yield kind.colour, f"{kind.words} ({n})"


def _ranges(solved: SolvedSequence) -> Iterator[tuple[Cell | str, ...]]:
    for name, reasons in zip(solved.row_names, solved.reasons, strict=True):
        for start, stop, reason in dropped_ranges(reasons):
            span = f"{start} to {stop - 1}" if stop - start > 1 else f"{start}"
            yield name, span, str(stop - start), Cell(reason, kind="words-cell")


def _paths(solved: SolvedSequence) -> dict[str, object]:
    world_from_cam = solved.world_from_cam
    if world_from_cam is None:
        return {"above": None}
    aligned = None
    if solved.dataset_camera is not None:
        aligned = align_dataset_camera(world_from_cam, solved.dataset_camera, solved.kept)
    return {
        "above": svg(
            lambda plot: solved_plots.plot_paths(plot, solved, aligned), 7.4, 6.2, "paths"
        ),
        "side": svg(lambda plot: solved_plots.plot_side_view(plot, solved), 7.4, 6.2, "side"),
        "people": [(solved_plots.person_role(n), f"person {n}") for n in solved.clips],
        "aligned": aligned,
    }


def _level_cues(record: PseudoGtQuality) -> Table | None:
    """What says which way is up, and how level the world is."""
    if record.level is None:
        return None
    rows = [
        (
            one.name,
            f"{one.apart_deg:.1f}",
            f"{one.sigma_deg:.1f}",
            "yes" if one.used else "no" if one.name == "picture" else "no: steep",
        )
        for one in record.level.cues
    ]
    headings = ("cue", "from the up that was taken [deg]", "standard error [deg]", "used")
    foot = ("together", "", f"{record.level.sigma_deg:.1f}", "")
    unseen = record.level.floor_sigma_m
    floor = f" Nobody's feet were seen: the floor is good to {unseen:g} m." if unseen else ""
    return Table(headings, rows, f"Which way is up, cue by cue.{floor}", foot)


def _percent(part: float, whole: float, sign: str = "") -> str:
    """A share [%], of what the cues may put at zero and below."""
    return f"{100 * part / whole:{sign}.2f}" if whole > 0 else NO_FIGURE


def _scale_cues(record: PseudoGtQuality) -> dict[str, object]:
    level = _level_cues(record)
    scale, sigma, cues = record.scale, record.scale_sigma, record.scale_cues
    if scale is None or sigma is None or not cues:
        return {"table": None, "level": level}
    rows = [
        (solved_plots.cue_words(cue), f"{cue.scale:.5g}", _percent(cue.sigma, cue.scale),
         _percent(cue.scale - scale, scale, "+"), str(cue.support), f"{1000 * cue.residual_m:.1f}")
        for cue in cues
    ]  # fmt: skip
    foot = ("fused", f"{scale:.5g}", _percent(sigma, scale), "", "", "")
    headings = (
        "cue", "scale [m per unit]", "standard error [%]", "from the fused [%]",
        "stances, points or windows", "residual [mm]",
    )  # fmt: skip

    def draw(plot: Figure) -> None:
        solved_plots.plot_scale_cues(plot, scale, sigma, cues)

    return {
        "plot": svg(draw, 7.4, 1.0 + 0.32 * (len(cues) + 1), "scale") if scale > 0 else None,
        "table": Table(headings, rows, "The metric scale, cue by cue.", foot),
        "level": level,
    }


def _camera_class(record: PseudoGtQuality, config: MotionClassConfig) -> Table:
    figures = record.camera_motion_figures
    rows = [] if figures is None else thresholds.class_rows(figures, config)
    caption = Markup(
        "Of the recovered camera in the frames that have one and a body; see "
        "<code>gmrdata.values.camera_motion</code>."
    )
    return thresholds.threshold_table(rows, "borders of the classes", caption)


def _reconstruction_rows(cameras: CamerasQuality) -> list[tuple[str, object]]:
    rows = [
        ("Geometry", GEOMETRY_WORDS[cameras.geometry]),
        ("Mapper", cameras.mapper),
        ("Models", len(cameras.models)),
        ("Frames with a camera", f"{cameras.frames_with_camera} of {cameras.frames}"),
        ("Keyframes", len(cameras.keyframes)),
        ("Frames placed against the finished map", cameras.resected_frames),
        ("Interpolated frames", len(cameras.interpolated)),
        ("Cuts", len(cameras.cuts_after_frames)),
        ("Points", cameras.points),
        ("Median frames per point", cameras.median_track_length),
        ("Median reprojection error [px]", cameras.median_reprojection_px),
    ]
    return [(name, value) for name, value in rows if value is not None]


def _lens(solved: SolvedSequence, camera: CameraPath) -> dict[str, object]:
    """The intrinsics, where they came from, and how well they are known."""
    lens, sides_px = solved.intrinsics, np.array([camera.width_px, camera.height_px])
    focal_px, centre_px = np.diag(camera.intrinsics_px)[:2], camera.intrinsics_px[:2, 2]
    angles = np.arctan(centre_px / focal_px) + np.arctan((sides_px - centre_px) / focal_px)
    numbers = dict.fromkeys(f"{one:.1f}" for one in focal_px.tolist())
    error = "" if lens is None else f" ± {100 * lens.focal_sigma:.2g} %"
    rows: list[tuple[str, object]] = [
        ("Focal length", f"{' and '.join(numbers)} px{error}"),
        ("Field of view", "{:.1f}° by {:.1f}°".format(*np.rad2deg(angles))),
        ("Principal point", "{:.1f}, {:.1f} px".format(*centre_px.tolist())),
        ("Picture", f"{camera.width_px}×{camera.height_px} px"),
        ("Where it comes from", GIVEN_AS_IT_IS if lens is None else SOURCES[lens.source]),
    ]
    if lens is not None and (not lens.lens.is_pinhole or lens.radial_k1_sigma is not None):
        spread = "" if lens.radial_k1_sigma is None else f" ± {lens.radial_k1_sigma:.2g}"
        second = f", k2 {lens.radial_k2:.4g}" if lens.radial_k2 else ""
        rows.append(("Radial distortion k1", f"{lens.radial_k1:.4g}{spread}{second}"))
    if solved.cameras is not None:
        rows += solved.cameras.lens_in_words
        lens = None if lens is None else beside_cameras(lens, solved.cameras)
    objections, notes = ((), ()) if lens is None else (lens.objections, lens.notes)
    return {"rows": rows, "objections": objections, "notes": notes}


def _downloads(solved: SolvedSequence, left_out: Sequence[tuple[str, str]]) -> dict[str, object]:
    """What lies in `files`, by format, what the stages keep of people, and what could not be
    written."""
    root, own, exported = _folder(solved), list(_own_files(solved)), []
    for download in DOWNLOADS:
        folder = root / FILES / download.format
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        exported.append((download.name, download.use, list(_links(root, files, folder))))
    return {
        "offers": [offer for offer in (*own, *exported) if offer[-1]],
        "exported": any(links for *_, links in exported),
        "rejected": np.array(solved.row_names)[np.logical_not(solved.accepted)].tolist(),
        "left_out": left_out,
        "most": MOST_LINKS,
    }


def _own_files(solved: SolvedSequence) -> Iterator[Offer]:
    """Name, use and links of what the stages keep of people."""
    folder = _folder(solved)

    def offer(name: str, use: str, stage: str, file: Callable[[int], str]) -> Offer:
        paths = [folder / stage / file(person) for person in range(len(solved.judged))]
        return name, use, list(_links(folder, paths, folder / stage))

    if solved.fused is None:
        yield offer("gmrdata npz", CLIP_USE, PSEUDO_GT, person_file)
        return
    from gmrdata.fusion.record import sigma_file

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
            yield href, text_of(path.relative_to(below).as_posix()), said


def _stages(solved: SolvedSequence, page_dir: Path) -> list[tuple[str, list[tuple[str, str]]]]:
    """Links to the records of the stages."""
    stages = []
    for stage, names in RECORDS.items() if solved.folder is not None else ():
        folder = _folder(solved) / stage
        there = [name for name in (STAGE_FILE, *names) if (folder / name).is_file()]
        where = Path(os.path.relpath(folder, page_dir)).as_posix()
        if there or (solved.dataset is not None and stage in OF_THREEDPW):
            stages.append((stage, [(quote(f"{where}/{name}"), name) for name in there]))
    return stages
