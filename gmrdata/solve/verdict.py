"""Whether what was made of a video can be used: its camera path, and each person in it.

Besides the cameras its times, its lost frames, its lens and people not seen speak against it.
"""

import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import NonNegativeFloat, model_validator

from gmrdata.cameras.again import AGAIN_FILE, AgainRecord
from gmrdata.cameras.check.verdict import (
    both_sides,
    camera_reasons,
    frame_tests,
    jump_cause,
    lens_notes,
    lens_reasons,
    turns_too_fast,
)
from gmrdata.cameras.files import load_cameras, load_quality
from gmrdata.cameras.lens.intrinsics import Intrinsics
from gmrdata.cameras.recipe import CamerasVerdictConfig
from gmrdata.people.sources import MasksConfig
from gmrdata.read.intrinsics import GIVEN_SIGMA
from gmrdata.solve.request import FRAMES, PeopleBySystem, Solved
from gmrdata.values.clip import Clip, file_name, first_reasons, load_clip
from gmrdata.values.files import STAGE_FILE
from gmrdata.values.frame_set import VideoRecord
from gmrdata.values.people import DOUBTS_FILE, PSEUDO_GT
from gmrdata.values.records import Record
from gmrdata.world.bodies import NOT_SEEN
from gmrdata.world.judge import PseudoGtQuality, load_record
from gmrdata.world.recipe import Doubts, PseudoGtConfig, Verdict, verdict_of
from gmrdata.write.cameras import BINARY_FOLDER, TEXT_FOLDER

NO_DOUBTS: Mapping[str, str] = {}
MAX_RATE_ERROR = 0.05
"""Share by which the rate of a body may differ from that of the video."""
RATE_OVER_S = 0.5  # over which the same holds of a video whose rate varies [s]
MAX_STEP_ERROR = 0.25
"""Share by which the time between two images may differ from that between the body's rows."""
VAGUE_SCALE = 0.1  # standard error, as a share, beyond which it is said
MOST_OFF = 0.99  # of a deviation, as a share


def with_lens_error(config: PseudoGtConfig, lens: Intrinsics | None) -> PseudoGtConfig:
    """The same, but that a focal length nobody measured may be off by two standard errors."""
    if lens is None or lens.focal_sigma <= GIVEN_SIGMA:
        return config
    most = max(config.verdict.max_focal_deviation, min(2 * lens.focal_sigma, MOST_OFF))
    thresholds = config.verdict.model_copy(update={"max_focal_deviation": most})
    return config.model_copy(update={"verdict": thresholds})


def lost_frames(video: VideoRecord | None) -> Iterator[str]:
    """What a video lost, in words; nothing for a whole one."""
    if video is not None and video.n_lost:
        yield f"{video.n_lost} of the video's {video.n_expected} frames could not be decoded"


def write_doubts(
    out_dir: Path,
    clips: Sequence[Clip],
    video: VideoRecord | None,
    lens: Intrinsics | None,
    of_people: Mapping[str, str] = NO_DOUBTS,
) -> Path | None:
    """`doubts.json` on people before the camera: what the video's times and losses say.

    Of a system's people, whose lens is found beside them, also frames without a pose and what the
    lens says; `of_people` says by a clip's id what speaks against all of its frames.  None without
    a record where bodies are given with their lens, and nothing is said.
    """
    path, doubts = out_dir / DOUBTS_FILE, video_doubts(video, clips)
    if lens is not None:
        frames = tuple(
            tuple(one if known else NOT_SEEN for known, one in zip(clip.valid, its, strict=True))
            for clip, its in zip(clips, doubts.frames, strict=True)
        )
        wrong = (of_people.get(clip.id, "") for clip in clips)
        frames = tuple(len(of) * (w,) if w else of for w, of in zip(wrong, frames, strict=True))
        doubts = Doubts(frames=frames, sequence=(*doubts.sequence, *lens.objections))
    elif not (doubts.sequence or any(map(any, doubts.frames))):
        path.unlink(missing_ok=True)
        return None
    doubts.write(path)
    return path


def video_doubts(video: VideoRecord | None, clips: Sequence[Clip]) -> Doubts:
    """What speaks against bodies on a video's frames: lost frames, and times that are others."""
    nothing = tuple(len(clip.image_numbers) * ("",) for clip in clips)
    if video is None:
        return Doubts(frames=nothing, sequence=())
    sequence = [
        f"{lost}, so that body and image may not belong together" for lost in lost_frames(video)
    ]
    step_s = np.diff(video.times_of(clips[0].image_numbers), prepend=np.nan)  # the same of all
    usual_s = float(np.nanmedian(step_s)) if np.isfinite(step_s).any() else np.nan
    odd: dict[float, tuple[str, ...]] = {}
    for fps_hz in dict.fromkeys(clip.motion.fps_hz for clip in clips):
        # Speeds are computed from the body's rate, so they are wrong by as much as it is.
        if abs(usual_s * fps_hz - 1.0) > MAX_RATE_ERROR:
            sequence.append(f"the body has {fps_hz:g} frames per second, the video {1 / usual_s:g}")
            return Doubts(frames=nothing, sequence=tuple(sequence))
        odd[fps_hz] = tuple(_odd_steps(step_s, fps_hz))
    frames = tuple(odd[clip.motion.fps_hz] for clip in clips)
    return Doubts(frames=frames, sequence=tuple(sequence))


def _odd_steps(steps_s: np.ndarray, fps_hz: float) -> Iterator[str]:
    """Why frames (T,) must not be used that are shown so long after the ones before; else empty."""
    off = steps_s * fps_hz - 1.0  # NaN where it is not known
    is_odd = np.abs(off) > MAX_STEP_ERROR
    reach = max(1, round(RATE_OVER_S * fps_hz / 2))
    for row, step_s in enumerate(steps_s.tolist()):
        around = slice(max(0, row - reach), row + reach + 1)
        regular = off[around][np.abs(off[around]) <= MAX_STEP_ERROR]
        if is_odd[row]:
            yield f"shown {step_s:.3f} s after the image before, not {1 / fps_hz:.3f} s"
        elif len(regular) and abs(mean := float(regular.mean())) > MAX_RATE_ERROR:
            yield f"among images at {fps_hz / (1 + mean):.3g} per second, not {fps_hz:.3g}"
        else:
            yield ""


VERDICT_FILE = "verdict.json"
PAGE, VIEW, OVERLAY = "index.html", "view3d.html", "overlay"
"""What is shown of a verdict, beside it."""
FILES, FOLDERS = "files", ("colmap", "bvh", "amass")
"""Files for other programs, and formats of a folder, in which others keep files of theirs too."""
CAMERA = "camera"
NOBODY = "none of the people can be used"
UNCHECKED = (
    "Whether the bodies lie on the people in the pictures was not checked: no masks were made "
    "without them. Use --masks person"
)
TOO_FEW = "whether the body lies on the person was not checked: too few frames have a mask"


class VideoVerdict(Record):
    """`verdict.json`: the decisions on a video and on its people."""

    format: Literal["gmrdata-video-verdict/1"] = "gmrdata-video-verdict/1"
    images_dir: str
    """Where the images are: "frames" beside this file for a video's, else a folder's own path."""
    fps_hz: NonNegativeFloat
    """Images per second."""
    accepted: bool
    """The camera path can be used and, where people were asked for, one of them."""
    reasons: tuple[str, ...]
    """Why not."""
    camera: Verdict
    """On the camera path alone, frame by frame."""
    people: tuple[Verdict, ...]
    """By person; empty for cameras alone."""
    notes: tuple[str, ...]
    """What one should know besides."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.accepted == bool(self.reasons):
            raise ValueError("accepted and reasons do not say alike whether it is")
        return self


def forget_result(out_dir: Path) -> None:
    """Remove the verdict on what was solved, and all that shows it: page, overlay, and files for
    other programs.  What others put beside these stays."""
    people = {path.stem for path in out_dir.glob(f"{PSEUDO_GT}/*.npz")}
    remove_written(out_dir / FILES, {file_name(out_dir.absolute().name), *people})
    for name in (PAGE, VERDICT_FILE, VIEW):
        (out_dir / name).unlink(missing_ok=True)
    if (out_dir / OVERLAY / STAGE_FILE).is_file():
        shutil.rmtree(out_dir / OVERLAY, ignore_errors=True)  # of a link only what it leads to


def remove_written(files: Path, names: set[str]) -> None:
    """Remove what was written of cameras alone, of people and sequences of these names, and of
    others whose folders tell: by files of their name, or by a model in both forms."""
    written = {files / "colmap": own_parts(files / "colmap", "")}
    for folder in (folder for format in FOLDERS for folder in (files / format).glob("*/")):
        own = own_parts(folder, folder.name)
        if folder.name in names or len(own) > 1 or (own and own[0].is_file()):
            written[folder] = own
            names = names | {folder.name}
    alone = [files / "tum" / f"{name}.txt" for name in {"camera", *names}]
    alone += [files / "glb" / f"{name}.glb" for name in names]
    for path in [*alone, *(part for own in written.values() for part in own)]:
        remove(path)
        for left in (folder for folder in path.parents if files in folder.parents):
            with suppress(OSError):  # not empty, or gone
                left.rmdir()


def own_parts(folder: Path, name: str) -> list[Path]:
    """What is written in a folder of `FOLDERS`: forms of a COLMAP model, and files that bear the
    name and their frames."""
    run = re.compile(re.escape(name) + r"_\d{5,}-\d{5,}\.(bvh|npz)")
    forms = [folder / form for form in (BINARY_FOLDER, TEXT_FOLDER)]
    runs = (file for file in folder.glob("*") if run.fullmatch(file.name))
    return [*filter(Path.is_dir, forms), *runs]


def remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def judge_video(solved: Solved) -> VideoVerdict:
    """The verdict on a video that was solved: its cameras, and each person by these."""
    request, frames, lens = solved.request, solved.frames, solved.lens
    assert lens is not None
    notes = list(lens.notes)
    if solved.sfm_dir is None:
        camera = unsolved(_why(solved), len(frames.numbers))
    else:
        thresholds, cameras = solved.config.pseudo_gt.verdict, load_cameras(solved.sfm_dir)
        doubts = [*lost_frames(frames.video), *lens_reasons(cameras, lens, thresholds)]
        if solved.again_dir is not None:
            doubts += AgainRecord.read(solved.again_dir / AGAIN_FILE).reasons(thresholds)
        camera = judge_cameras(solved.sfm_dir, frames.rate_hz, thresholds, doubts)
        notes += lens_notes(cameras, lens)
    notes += solved.remarks
    if solved.world_dir is not None:
        world = load_record(solved.world_dir)
        people = world.people
        if world.level is not None:
            notes += [one for one in (world.level.remark, world.level.tipped) if one is not None]
        notes += [*_scale_notes(world), *_unchecked(world, solved.config.masks)]
    else:  # all share the reason
        clips = [load_clip(person.clip_path) for person in solved.bodies]
        why = str(solved.unsolved)
        people = tuple(unsolved(why, len(clip.image_numbers), clip.id) for clip in clips)
    decide = isinstance(request.people, PeopleBySystem) and request.people.asked
    reasons = reasons_of(camera, people if decide else ())
    if decide and not people:
        reasons = reasons or (NOBODY, *solved.remarks)
    return VideoVerdict(
        images_dir=FRAMES if frames.video_path else str(frames.folder.resolve()),
        fps_hz=frames.rate_hz,
        accepted=not reasons,
        reasons=reasons,
        camera=camera,
        people=people,
        notes=tuple(notes),
    )


def _scale_notes(world: PseudoGtQuality) -> Iterator[str]:
    """What one should know of a scale that is hardly known."""
    if not (world.scale and world.scale_sigma and world.scale_matters):
        return
    if (share := world.scale_sigma / world.scale) > VAGUE_SCALE:
        unseen = any(cue.name == "above_ground" for cue in world.scale_cues)
        why = ": nobody's feet were seen to stand on the ground" if unseen else ""
        yield f"the metric scale is uncertain by {share:.0%}, and ways and speeds with it{why}"


def _unchecked(world: PseudoGtQuality, masks: MasksConfig | None) -> list[str]:
    """Of whom nothing says that the body lies on the person; masks may show nobody."""
    if masks is None or not masks.show_people:
        return [UNCHECKED]
    people = zip(world.people, world.picture_fits, strict=True)
    return [f"{person.id}: {TOO_FEW}" for person, fit in people if fit is None]


def _why(solved: Solved) -> str:
    """Why there are no cameras, by a path that holds where the folder is moved."""
    assert solved.unsolved is not None and solved.lens is not None
    images_dir = solved.frames.folder
    if images_dir.is_relative_to(solved.out_dir):
        images_dir = images_dir.relative_to(solved.out_dir)
    return "; ".join([str(solved.unsolved.of(images_dir)), *solved.lens.objections])


def judge_cameras(
    sfm_dir: Path, fps_hz: float, config: CamerasVerdictConfig, doubts: Sequence[str] = ()
) -> Verdict:
    """The verdict on a camera path by itself, without bodies or metres.

    `doubts` say why its video can't be used at all.
    """
    cameras, quality = load_cameras(sfm_dir), load_quality(sfm_dir)
    n, known = cameras.path.n_frames, cameras.path.has_camera
    world_from_cam = np.where(known[:, None, None], cameras.path.world_from_cam, np.nan)
    fast = turns_too_fast(world_from_cam, fps_hz, config)
    tests = frame_tests(quality, np.arange(n), known, config)
    reasons = first_reasons([""] * n, [*tests, (~both_sides(fast, 1, n), "the camera jumps")])
    failed = [*doubts, *camera_reasons(quality, config)]
    if len(fast) and (share := float(fast.mean())) > config.max_cuts_share:
        cause = jump_cause(world_from_cam, quality, config)
        failed.append(f"the camera jumps at {share:.0%} of the steps: {cause}")
    return verdict_of(CAMERA, not failed, failed, reasons)


def unsolved(why: str, n_frames: int, name: str = CAMERA) -> Verdict:
    """The verdict on a video of which no camera path was found, or on a person without a world."""
    return verdict_of(name, False, [why], n_frames * [why])


def reasons_of(camera: Verdict, people: Sequence[Verdict]) -> tuple[str, ...]:
    """Why a video is rejected; none where it is accepted.  A reason that all share stands once."""
    if not camera.accepted:
        return camera.reasons
    if not people or any(person.accepted for person in people):
        return ()
    if len(people) == 1:
        return people[0].reasons
    each = (f"{one.id}: {reason}" for one in people for reason in one.reasons)
    return (NOBODY, *each)
