"""Exported clips as takes: who is in a sequence, its background, and the truth in the same rows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gmrdata.export.sources import ExportedClip
from gmrdata.stage.progress import remark
from gmrdata.twins.pseudo_gt_error import body_points_m, paired_rows
from gmrdata.values import transforms
from gmrdata.values.body import BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadRecord, MissingInput
from gmrdata.write.take import Performer, Take

RESULT, TRUTH = "result", "truth"


def result_take(clips: Sequence[ExportedClip]) -> Take:
    """The people of one sequence, then those who move besides, each under the clip's id."""
    people = [Performer(one.id, one.clip.motion, one.body, one.clip.valid) for one in clips]
    for extra in clips[0].extras:
        body = _same_body(clips[0], extra)
        people.append(Performer(extra.id, extra.motion, body, extra.valid))
    return Take(RESULT, tuple(people), clips[0].clip.camera)


def with_points(take: Take, exported: ExportedClip) -> Take:
    """The same with the background points of the sequence, if they have a place in its world."""
    from gmrdata.world.compose import load_background

    if exported.sfm_dir is None:
        return take
    try:
        return replace(take, points_m=load_background(exported.sfm_dir, exported.clip).points_m)
    except BadRecord as error:
        remark(f"{exported.id}: no points: {error}")
        return take


def truth_take(clips: Sequence[ExportedClip]) -> tuple[Take, np.ndarray] | None:
    """The truth of those who have one, and (4, 4) where its world lies in that of the clips.

    Its rows are those of the clips, and nobody is shown in a row that it lacks.  The transform fits
    the bodies' places and orientations best.
    """
    pairs = [(one, _in_rows_of(one.clip, one.truth)) for one in clips if one.truth is not None]
    if not pairs:
        return None
    people = [
        Performer(one.id, true.motion, _same_body(one, true), true.valid) for one, true in pairs
    ]
    points_m: list[list[np.ndarray]] = [[], []]
    for one, true in pairs:
        rows = np.flatnonzero(one.clip.valid & true.valid)
        points_m[0].append(body_points_m(one.clip, rows))
        points_m[1].append(body_points_m(true, rows))
    here_m, there_m = map(np.concatenate, points_m)
    if not len(here_m):
        raise MissingInput(f"clip {clips[0].id}: no frame is valid in it and in its truth")
    fit = transforms.fit_similarity(here_m, there_m, scale=False)
    placed = transforms.rigid(fit.rotmat, fit.translation_m)
    return Take(TRUTH, tuple(people), pairs[0][1].camera), placed


def _in_rows_of(clip: Clip, truth: Clip) -> Clip:
    """The truth with the rows of a clip."""
    rows, true_rows = paired_rows(clip, truth)
    taken, there = np.zeros(clip.motion.n_frames, dtype=int), np.zeros(len(clip.valid), dtype=bool)
    taken[rows], there[rows] = true_rows, True
    paired = truth.take(taken)
    camera, valid = paired.camera, paired.valid & there
    if camera is not None:
        camera = replace(camera, has_camera=camera.has_camera & there)
    return replace(paired, valid=valid, image_numbers=clip.image_numbers, camera=camera)


def _same_body(exported: ExportedClip, other: Clip) -> BodyModel:
    """The body of another clip of the sequence, which is the person's own kind of body."""
    if other.motion.body != exported.body.name:
        what = f"clip {exported.id}: {other.id} needs the body {other.motion.body}"
        raise MissingInput(f"{what}, and only {exported.body.name} is at hand")
    return exported.body
