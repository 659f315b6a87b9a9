"""The result to turn round in the browser: one HTML file that needs nothing beside it.

three.js draws it, as trimesh ships it for its own viewer (MIT); a body is the GLB that `write_glb`
writes.  The world is z-up, in the unit of what is shown.
"""

import base64
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import resources
from io import BytesIO
from pathlib import Path

import numpy as np
from markupsafe import Markup

from gmrdata.pages.html import render, write_page
from gmrdata.pages.plots import COLOURS, aligned_paths
from gmrdata.pages.report_data import ClipReport
from gmrdata.pages.solved import SolvedSequence
from gmrdata.pages.solved_plots import person_role
from gmrdata.values.body import BodyModel
from gmrdata.values.camera import CameraPath
from gmrdata.values.clip import Clip
from gmrdata.values.errors import MissingInput
from gmrdata.write.glb import glb_bytes
from gmrdata.write.take import finite_rows

MOST_FRAMES = 600  # of a longer sequence every second, third, ... frame is shown
MOST_POINTS = 20_000
MOST_BODIES = 3  # of about 1.3 MB each; further people are paths
END_OF_THREE = "var camera,controls,scene"  # where trimesh's own viewer begins behind three.js


@dataclass(frozen=True, eq=False)
class ViewedPerson:
    """One person over the T frames of a view."""

    clip: Clip
    role: str  # its colour, by `plots.COLOURS`
    body: BodyModel | None = None  # None for a body that is not at hand: the path alone is shown
    sigma_m: np.ndarray | None = None  # (T, 3) standard deviation of the pelvis's place


@dataclass(frozen=True, eq=False)
class ViewedWorld:
    """A world, z up, over T frames."""

    times_s: np.ndarray  # (T,)
    people: Sequence[ViewedPerson] = ()
    camera: CameraPath | None = None  # of the T frames
    points: np.ndarray | None = None  # (N, 3) of the background
    unit: str = "m"

    @property
    def rows(self) -> np.ndarray:
        """Frames that are shown."""
        return np.arange(0, len(self.times_s), -(-len(self.times_s) // MOST_FRAMES))


def view_of(solved: SolvedSequence) -> ViewedWorld:
    """The world of a solved sequence; MissingInput where there is nothing to look at."""
    if solved.camera is None and not solved.clips:
        raise MissingInput("no camera and no motion was found, so there is nothing to turn round")
    bodies = {one.clip.id: one.body for one in solved.people}  # of those whose body is at hand
    people = tuple(
        ViewedPerson(
            clip,
            person_role(number),
            bodies.get(clip.id),
            None if solved.fused is None else solved.fused.sigmas[number]["place_sigma_m"],
        )
        for number, clip in solved.clips.items()
    )
    times_s = solved.times_s
    if not len(times_s):  # a data set's frames have a rate alone
        rates_hz = [clip.motion.fps_hz for clip in solved.clips.values()]
        times_s = np.arange(solved.n_frames) / next(iter(rates_hz), 1.0)
    return ViewedWorld(times_s, people, solved.camera, solved.world_points, solved.unit)


def view_of_clip(clip: ClipReport) -> ViewedWorld:
    """The true and the recovered person, and the recovered camera, in the true world."""
    pelvis_m, world_from_cam = aligned_paths(clip)
    motion, camera = clip.pseudo.motion, clip.pseudo.camera
    root_rotmats = clip.true_from_pseudo[:3, :3] @ motion.root_rotmats
    moved = replace(motion, root_rotmats=root_rotmats, pelvis_m=pelvis_m)
    if camera is not None and world_from_cam is not None:
        camera = replace(camera, world_from_cam=world_from_cam)
    people = (
        ViewedPerson(clip.true, "person-pale", clip.body),
        ViewedPerson(replace(clip.pseudo, motion=moved), "person", clip.body),
    )
    return ViewedWorld(np.arange(motion.n_frames) / motion.fps_hz, people, camera)


def write_view(path: Path, view: ViewedWorld) -> Path:
    """Write the file; gives its path."""
    three = Markup(_three_js())  # trimesh's own text, not a value of ours
    return write_page(path, render("view3d", three=three, view=_described(view)))


def _described(view: ViewedWorld) -> dict[str, object]:
    """What the script takes: numbers in little-endian base64."""
    rows, camera = view.rows, view.camera
    points = np.zeros((0, 3)) if view.points is None else view.points
    step = max(1, -(-len(points) // MOST_POINTS))
    return {
        "times_s": np.round(view.times_s[rows] - view.times_s[0], 4).tolist(),
        "frames": rows.tolist(),
        "unit": view.unit,
        "points": _packed(points[::step]),
        "camera": None if camera is None else _camera(camera, rows),
        "colours": {name: COLOURS[name] for name in ("camera", "muted")},
        "people": [
            _person(one, rows, has_body=number < MOST_BODIES)
            for number, one in enumerate(view.people)
        ],
    }


def _camera(camera: CameraPath, rows: np.ndarray) -> dict[str, object]:
    """world_from_cam row by row, and half the picture at a depth of 1."""
    focal_px = np.diag(camera.intrinsics_px)[:2]
    half = np.array([camera.width_px, camera.height_px]) / focal_px / 2
    return {"world_from_cam": _packed(camera.world_from_cam[rows]), "half": half.tolist()}


def _person(person: ViewedPerson, rows: np.ndarray, *, has_body: bool) -> dict[str, object]:
    motion, glb = person.clip.motion, b""
    shown = finite_rows(motion) & np.isin(np.arange(motion.n_frames), rows)
    if person.body is not None and has_body and shown.any():
        glb = glb_bytes(motion, person.body, shown=shown)
    sigma_m = None if person.sigma_m is None else _packed(person.sigma_m[rows])
    return {
        "colour": COLOURS[person.role],
        "fps_hz": motion.fps_hz,
        "pelvis": _packed(motion.pelvis_m[rows]),
        "sigma": sigma_m,
        "seen": person.clip.valid[rows].astype(int).tolist(),
        "glb": base64.b64encode(glb).decode(),
    }


def _packed(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()


def _three_js() -> str:
    """three.js with its loader of glTF and its controls, out of trimesh's template."""
    packed = resources.files("trimesh").joinpath("resources/templates/viewer.zip").read_bytes()
    with zipfile.ZipFile(BytesIO(packed)) as archive:
        text = archive.read("viewer.html.template").decode("utf-8")
    start, end = text.find("<script>"), text.find(END_OF_THREE)
    if min(start, end) < 0:
        raise MissingInput("this version of trimesh has another viewer. Install trimesh 4")
    return text[start + len("<script>") : end]
