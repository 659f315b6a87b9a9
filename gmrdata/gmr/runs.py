"""Clips of manifests: which can be trained on or scored, and their runs of valid frames.

A clip's subject and trial are read from its source in the manifest.  A CMU trial is the same
recording in each form: `CMU 02_03` from ASF/AMC or BVH, and AMASS's `CMU/02/02_03_poses`.  A file
of unknown origin whose name is a CMU trial's is taken for that trial: rather a clip too few than
one that is scored later.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath

import numpy as np

from gmrdata.gmr.config import DataConfig
from gmrdata.manifest.current import ClipEntry, Manifest, Source
from gmrdata.manifest.read import listed_path, load_entry, published_list, read_data_set
from gmrdata.motion.resample import resample, valid_runs
from gmrdata.read.source_motion import CMU_TRIAL, in_cmu
from gmrdata.values.body import BodyModel, body_of
from gmrdata.values.clip import Clip, clip_on_body
from gmrdata.values.errors import BadManifest, BadMotionFile, BadRecipe, GmrdataError
from gmrdata.values.motion import Motion, whole_ratio


@dataclass(frozen=True, eq=False)
class UsableClip:
    clip: Clip
    camera_motion: str  # class of its camera's motion: "none" without a camera


@dataclass(frozen=True)
class ClipFile:
    """A clip that the manifest vouches for, still on disk."""

    manifest_path: Path
    entry: ClipEntry

    @property
    def arrays_path(self) -> Path:
        """The clip's file; BadManifest where a link to it leads out of the manifest's folder."""
        return listed_path(self.manifest_path, self.entry, "arrays.path", self.entry.arrays.path)

    def load(self) -> Clip:
        return load_entry(self.manifest_path, self.entry)


class LazyClips(Sequence[Clip]):
    """Clips that are read each time that they are asked for: a set may exceed the memory."""

    def __init__(self, files: Sequence[ClipFile]) -> None:
        self._files = files

    def __len__(self) -> int:
        return len(self._files)

    def __getitem__(self, index: int) -> Clip:  # type: ignore[override]  # nobody takes slices
        return self._files[index].load()


def usable_files(path: Path) -> tuple[list[ClipFile], dict[str, str], Manifest]:
    """The clips of a manifest, except those that its quality record rejects or of which no frame is
    kept; the reason by id for those; and the manifest."""
    manifest = read_data_set(path)
    files, skipped = [], {}
    for entry in manifest.clips:
        if entry.quality is not None and entry.quality.verdict == "rejected":
            skipped[entry.id] = "rejected: " + "; ".join(entry.quality.reasons)
        elif not entry.kept:
            skipped[entry.id] = "no frame is valid"
        else:
            files.append(ClipFile(path, entry))
    return files, skipped, manifest


def fitting_clips(clips: Iterable[Clip], bodies: Sequence[BodyModel]) -> Iterator[Clip]:
    """The clips one by one, each with as many shape coefficients as its body.

    BadManifest, when its turn comes: a clip of no such body, or not in the world; or no clip.
    """
    clip = None
    for clip in clips:
        if clip.motion.frame != "world":
            raise BadManifest(
                f"clip {clip.id}: its motion is in the camera's frame, which moves. Give clips in"
                " the world frame"
            )
        remedy = "Give the clips' own body, or a folder with the bodies of all"
        body = given_body(clip.motion, bodies, BadManifest, f"clip {clip.id}: of", remedy)
        yield clip_on_body(clip, body)
    if clip is None:
        raise BadManifest(NO_CLIPS)


def given_body(
    motion: Motion, bodies: Sequence[BodyModel], error: type[GmrdataError], whose: str, remedy: str
) -> BodyModel:
    """Which of some bodies a motion is of; an error of a kind where it is of none of them."""
    if (body := body_of(motion, bodies)) is not None:
        return body
    given = ", ".join(f"{one.name} with {one.n_shape}" for one in bodies)
    raise error(
        f"{whose} body {motion.body} with {motion.shape.size} shape coefficients, but the given"
        f" body is {given}. {remedy}"
    )


def no_runs(n_clips: int, what: str, fps_hz: float, remedy: str) -> BadManifest:
    """The error that clips have no motion at a frame rate."""
    said = f"none of the {n_clips} {what} clips has two valid frames in a row at {fps_hz:g} fps"
    return BadManifest(f"{said}. {remedy}")


NO_CLIPS = "no usable clips. Give manifests with clips that keep frames and are not rejected"
MIN_FRAMES = 2  # which make one motion


def runs_at(clip: Clip, fps_hz: float, *, all_phases: bool) -> list[Motion]:
    """Runs of a clip's valid frames at a frame rate; none of them crosses a gap.

    Where the clip's rate is k times the asked one, every k-th frame is taken as it is; all k phases
    of that, or the one that begins with the run's first frame.  Other ratios are resampled.  Runs
    have at least two frames.
    """
    check_finite(clip)
    check_rate(clip.id, clip.motion.fps_hz, fps_hz)
    step = whole_ratio(clip.motion.fps_hz, fps_hz)
    n_phases = (step or max(1, int(clip.motion.fps_hz / fps_hz))) if all_phases else 1
    rows = run_slices(clip.valid, step or 1, n_phases)
    if step is not None:
        return [clip.motion.take(part, fps_hz) for part in rows]
    resampled = (resample(clip.motion.take(part), fps_hz) for part in rows)
    return [motion for motion in resampled if motion.n_frames >= MIN_FRAMES]


def run_slices(valid: np.ndarray, step: int, n_phases: int) -> list[slice]:
    """Each `step`-th row of the runs of `valid` (T,) ones, two or more: all in the first phase of a
    run, then all in the next, which begins a row later."""
    return [
        slice(start + phase, stop, step)
        for start, stop in valid_runs(valid)
        for phase in range(min(n_phases, stop - start - (MIN_FRAMES - 1) * step))
    ]


def check_rate(
    clip_id: str, fps_hz: float, wanted_hz: float, remedy: str = "Use a source of a higher rate"
) -> None:
    """Refuse a frame rate below the wanted one [Hz], with a BadMotionFile."""
    if fps_hz / wanted_hz < 1 - 1e-3:
        raise BadMotionFile(
            f"clip {clip_id}: {fps_hz:g} fps is lower than {wanted_hz:g} fps, so frames would have"
            f" to be made up. {remedy}"
        )


def check_finite(clip: Clip) -> None:
    """Refuse NaN and infinities in valid frames, with a BadMotionFile."""
    motion = clip.motion
    finite = np.isfinite(motion.local_rotmats).all((1, 2, 3))
    finite &= np.isfinite(motion.root_rotmats).all((1, 2)) & np.isfinite(motion.pelvis_m).all(1)
    bad = np.flatnonzero(clip.valid & ~finite)
    if bad.size or not np.isfinite(motion.shape).all():
        where = f"frame {bad[0]}" if bad.size else "its shape"
        raise BadMotionFile(
            f"clip {clip.id}: {where} holds NaN or infinite numbers ({bad.size} frames in all)."
            " Mark such frames as not valid, or make the clip again"
        )


_OTHERS = ("gmrdata", "3DPW", "Human3.6M", "EMDB")  # no CMU trials, whatever they are called


@dataclass(frozen=True)
class Mix:
    """How clips in a row belong to parts of manifests, and how often windows come from each."""

    sizes: tuple[int, ...]  # number of clips of each part, in order
    weights: tuple[float, ...] | None = None  # share of each manifest; None: by its frames
    names: tuple[str, ...] = ()  # of the manifests, for messages
    manifests: tuple[int, ...] | None = None  # of which each part is; None: each is one
    balance: float = 1.0  # the parts of a manifest count by their frames to this power

    @property
    def sizes_of_manifests(self) -> tuple[int, ...]:
        """Number of clips of each manifest, in order."""
        manifests = self.manifests or range(len(self.sizes))
        return tuple(np.bincount(manifests, self.sizes).astype(int).tolist())

    def shares(self, n_frames: np.ndarray) -> tuple[float, ...] | None:
        """How often windows come from parts of so many frames (P,); None: by the frames."""
        if self.weights is None and self.balance == 1:
            return None
        manifest = np.array(self.manifests or range(len(self.sizes)))
        of_manifest = np.bincount(manifest, n_frames)
        own = np.power(n_frames, self.balance, where=n_frames > 0, out=np.zeros(len(n_frames)))
        whole = np.bincount(manifest, own)
        if self.weights is not None:
            for empty in np.flatnonzero(whole == 0):
                name = f"manifest {self.names[empty] if self.names else f'number {empty}'}"
                said = f"{name} has a weight, but no clip of it gives a window"
                raise BadManifest(f"{said}. Leave it out")
            of_manifest = np.array(self.weights)
        return tuple((of_manifest[manifest] * own / np.maximum(whole, 1e-300)[manifest]).tolist())


@dataclass(frozen=True)
class Split:
    """The clips of all manifests."""

    training: tuple[ClipFile, ...]  # manifest by manifest
    held_out: tuple[ClipFile, ...]  # of the held-out subjects, to score
    left_out: dict[str, int]  # how many clips are not trained on, by the reason
    mix: Mix  # how the training clips belong to the manifests

    @property
    def statement(self) -> str:
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.left_out.items())
        n_out, n = sum(self.left_out.values()), len(self.training)
        out = f"not trained on: {n_out} of {n + n_out} clips ({reasons})" if n_out else ""
        if self.mix.balance == 1:
            return out
        n_nobody = sum(subject_of(one.entry.source) is None for one in self.training)
        one = f"data.balance: {n_nobody} of {n} clips name nobody, and count as one person's"
        return "; ".join(filter(None, (out, one if n_nobody else "")))


def split_manifests(
    manifest_paths: Sequence[Path],
    config: DataConfig,
    *,
    may_lack_people: bool = False,
    to_train: bool = True,
) -> Split:
    """Choose the clips of manifests.  BadRecipe where a held-out subject has none, unless
    `may_lack_people`; BadManifest where none can be trained on, unless that is not what they are
    for."""
    if config.weights is not None and len(config.weights) != len(manifest_paths):
        raise BadRecipe(
            f"data.weights has {len(config.weights)} weights for {len(manifest_paths)} manifests."
            " Give one for each, or none"
        )
    lists = {name: _listed(name) for name in config.never_train_on}
    wanted = {_subject_key(subject): str(subject) for subject in config.held_out_subjects}
    training: list[list[ClipFile]] = []
    held_out: list[ClipFile] = []
    present: set[str] = set()
    left_out: Counter[str] = Counter()
    for path in manifest_paths:
        training.append([])
        files, unusable, _ = usable_files(path)
        for why in unusable.values():
            left_out["rejected" if why.startswith("rejected") else "without a valid frame"] += 1
        for file in files:
            subject = subject_of(file.entry.source)
            on_lists = [name for name in lists if source_key(file.entry.source) in lists[name]]
            if subject is not None and subject in wanted:
                present.add(subject)
                held_out.append(file)
                left_out[f"of held-out subject {wanted[subject]}"] += 1
            elif on_lists:
                left_out[f"on the list {on_lists[0]}"] += 1
            else:
                training[-1].append(file)
    missing = [name for key, name in wanted.items() if key not in present]
    if missing and not may_lack_people:
        raise BadRecipe(f"data.held_out_subjects: no clip is of {', '.join(missing)}")
    names = tuple(path.name for path in manifest_paths)
    parts = [(n, part) for n, files in enumerate(training) for part in _parts(files, config)]
    sizes, of = tuple(len(part) for _, part in parts), tuple(n for n, _ in parts)
    mix = Mix(sizes, config.weights, names, of, config.balance)
    split = Split(tuple(chain(*(part for _, part in parts))), tuple(held_out), dict(left_out), mix)
    if to_train and not split.training:
        remedy = "Give others, or change data.never_train_on or data.held_out_subjects"
        said = f"no usable clips ({split.statement}). {remedy}"
        raise BadManifest(said if split.left_out else NO_CLIPS)
    return split


def require_own_ids(files: Sequence[ClipFile], what: str) -> None:
    """Refuse clips of one id, with a BadManifest that calls them `what`."""
    often = Counter(file.entry.id for file in files)
    if twice := sorted(id for id, n in often.items() if n > 1):
        raise BadManifest(f"{what} of one id in two manifests: {', '.join(twice)}")


def scored_files(held_out_paths: Sequence[Path], split: Split) -> tuple[list[ClipFile], str]:
    """What a training scores, each once: held-out people, and clips of manifests but those that
    are trained on, who would choose weights that know nobody else; and how many those are."""
    asked = [file for path in held_out_paths for file in usable_files(path)[0]]
    others = not_trained_on(asked, split.training)
    n_known = len(asked) - len(others)
    said = f"not scored: {n_known} of {len(asked)} held-out clips are trained on" if n_known else ""
    return list({one.entry.arrays.sha256: one for one in (*others, *split.held_out)}.values()), said


def not_trained_on(files: Sequence[ClipFile], training: Sequence[ClipFile]) -> list[ClipFile]:
    """Those of some clips that are not among those of a training, in whatever form."""
    known = {key for file in training for key in _known_by(file)}
    return [file for file in files if known.isdisjoint(_known_by(file))]


def _known_by(file: ClipFile) -> set[str | tuple[str, str]]:
    """A clip's arrays, and its recording where its source tells it: other forms have others."""
    recording = recording_of(file.entry.source)
    return {file.entry.arrays.sha256} | ({recording} if recording else set())


def _parts(files: list[ClipFile], config: DataConfig) -> list[list[ClipFile]]:
    """A manifest's clips, person by person where people are balanced; those of nobody who is named
    count as one's."""
    if config.balance == 1 or not files:
        return [files]
    people: dict[str | None, list[ClipFile]] = {}
    for file in files:
        people.setdefault(subject_of(file.entry.source), []).append(file)
    return list(people.values())


def subject_of(source: Source) -> str | None:
    """Who moves: `CMU/02`, `KIT/3` of AMASS, `Human3.6M/S9`, `EMDB/P0`; None if that isn't said."""
    trial = cmu_trial(source)
    if trial is not None:
        return _subject_key(int(trial.partition("_")[0]))
    parts = PurePosixPath(source.sequence).parts
    if source.dataset == "AMASS" and len(parts) == 3:
        return f"{parts[0]}/{parts[1]}"
    if source.dataset in ("Human3.6M", "EMDB") and len(parts) > 1:
        return f"{source.dataset}/{parts[0]}"
    return None


def cmu_trial(source: Source) -> str | None:
    """The CMU trial that a clip is of, like 02_03; None if it is of none."""
    path = PurePosixPath(source.sequence)
    is_another_set = source.dataset == "AMASS" and len(path.parts) == 3 and not in_cmu(path)
    if source.dataset in _OTHERS or is_another_set:
        return None
    # A clip's id, and so a file that is exported, has its folders in front: CMU.02.02_03_poses.
    words = path.name.split(".")
    match = next(filter(None, map(CMU_TRIAL.match, words)), None)
    return f"{int(match.group(1)):02d}_{match.group(2)}" if match else None


def _listed(name: str) -> frozenset[tuple[str, str]]:
    return frozenset(source_key(row.source) for row in published_list(name))


def source_key(source: Source) -> tuple[str, str]:
    """What a clip and a row of a list have in common."""
    return recording_of(source) or (source.dataset, source.sequence)


def recording_of(source: Source) -> tuple[str, str] | None:
    """What two clips of one recording of CMU or AMASS have in common, whatever form they are in.

    None for others: generated gaits and own files may differ under one name.
    """
    if (trial := cmu_trial(source)) is not None:
        return "CMU", trial
    in_amass = source.dataset == "AMASS" and len(PurePosixPath(source.sequence).parts) == 3
    if not in_amass:
        return None
    return "AMASS", source.sequence.removesuffix("_poses").removesuffix("_stageii")


def _subject_key(subject: int | str) -> str:
    text = str(subject)
    return f"CMU/{int(text):02d}" if text.isascii() and text.isdigit() else text
