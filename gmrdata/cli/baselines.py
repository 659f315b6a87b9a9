"""The verb for what GMR is compared with."""

from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import OmitSubcommandPrefixes, Positional, arg, subcommand

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe
from gmrdata.values.limits import MOST_DIGITS

Out = Annotated[
    Path, arg(help="Output folder: predictions/ with a clip file for each clip, predictions.json.")
]


def baseline_zero(manifest: flags.Manifest, out: Out, redo: flags.Redo = False) -> None:
    """Zero motion: everybody stays in the pose of the first frame."""
    from gmrdata.score.baselines import predict_zero

    answer(predict_zero(manifest, out, run=Run(redo=redo)))


def baseline_mean(
    manifest: flags.Manifest,
    training: tuple[Path, ...],
    out: Out,
    fps_hz: float = 10.0,
    redo: flags.Redo = False,
) -> None:
    """Mean motion: everybody repeats the mean dR and dT of training clips.

    Args:
        training: Manifests whose motions are averaged.
        fps_hz: Frame rate at which motions are averaged [Hz].
    """
    from gmrdata.score.baselines import MeanConfig, predict_mean

    flags.need(training, "a manifest to average: --training")
    with flags.flags_named():
        config = MeanConfig(fps_hz=fps_hz)
    answer(predict_mean(manifest, training, out, config, run=Run(redo=redo)))


def baseline_camera_as_world(
    manifest: flags.Manifest,
    out: Out,
    camera: Literal["ignored", "true", "recovered"] = "ignored",
    cameras: Path | None = None,
    redo: flags.Redo = False,
) -> None:
    """True poses in the camera's frame, taken as world poses: the camera's motion is ignored.

    Args:
        camera: ignored; or, as the reference that knows the camera, true or recovered.
        cameras: For recovered cameras: a folder with <clip id>/ as `gmrdata sfm --out` makes it.
    """
    from gmrdata.score.camera_as_world import CameraAsWorldConfig, predict_camera_as_world

    config = CameraAsWorldConfig(camera=camera)
    answer(predict_camera_as_world(manifest, out, config, cameras_dir=cameras, run=Run(redo=redo)))


def baseline_vibe_cam(
    manifest: flags.Manifest,
    poses: Annotated[Path, flags.POSES],
    keypoints: Annotated[Path, flags.KEYPOINTS],
    out: Out,
    person: tuple[str, ...] = (),
    image_size: tuple[int, int] | None = None,
    body: flags.Body = "anny",
    redo: flags.Redo = False,
) -> None:
    """VIBE-CAM: another network's camera-frame poses, placed by 2D keypoints, taken as world poses.

    Only the camera's intrinsics are used of the manifest's clips.

    Args:
        person: Tracks of STAF to follow, like walk_01=3. Other clips take the most confident person
            of each frame.
        image_size: Width and height of the images that the detector was given [px]; the camera's
            when left out.
    """
    from gmrdata.paper.vibe_cam import SeenFiles, VibeCamConfig, predict_vibe_cam

    remedy = "expected the clip's id, =, and a number, each clip once"
    tracks = flags.by_key("--person", person, remedy)
    for text, (clip_id, number) in zip(person, tracks.items(), strict=True):
        if not clip_id or not number.isdecimal() or len(number) > MOST_DIGITS:
            raise BadRecipe(f"--person {text}: {remedy}")
    person_ids = {clip_id: int(number) for clip_id, number in tracks.items()}
    with flags.flags_named():
        config = VibeCamConfig(person_ids=person_ids, image_size_px=image_size)
    files = SeenFiles(poses, keypoints, flags.body_path(body))
    answer(predict_vibe_cam(manifest, files, out, config, run=Run(redo=redo)))


def baseline_joint_train(
    manifests: flags.Manifests,
    features: Annotated[Path, flags.FEATURES],
    out: Path,
    recipe: Path | None = None,
    body: flags.Body = "anny",
    device: flags.Device = None,
    redo: flags.Redo = False,
) -> None:
    """Train the non-sequential model: local pose and world motion together from image features.

    Args:
        out: Run folder.
        recipe: A recipe file of kind `joint`; the defaults (GMR's) when left out.
    """
    from gmrdata.paper.joint import split_videos, train_joint
    from gmrdata.paper.plan import JointConfig
    from gmrdata.stage.recipes import load_recipe

    flags.need(manifests, "a manifest file")
    config = JointConfig() if recipe is None else load_recipe(recipe, JointConfig)
    config = flags.on_device(config, device)
    path, run = flags.body_path(body), Run(redo=redo)
    files = split_videos(manifests).training
    answer(train_joint(files, features, out, config, body_path=path, run=run))


def baseline_joint(
    run: Positional[Path],
    manifest: flags.Manifest,
    features: Annotated[Path, flags.FEATURES],
    out: Out,
    body: flags.Body = "anny",
    redo: flags.Redo = False,
) -> None:
    """The motion that a trained non-sequential model sees in a manifest's image features.

    Args:
        run: Run folder of `gmrdata baseline joint_train`.
    """
    from gmrdata.paper.joint import predict_joint

    path = flags.body_path(body)
    answer(predict_joint(run, manifest, features, out, body_path=path, run=Run(redo=redo)))


def baseline_own_poses(
    manifest: flags.Manifest,
    out: Annotated[Path, arg(help="Output folder: poses/, keypoints/, features/, seen/.")],
    detector: flags.Detector = None,
    landmark_network: flags.LandmarkNetwork = None,
    body: flags.Body = "anny",
    redo: flags.Redo = False,
) -> None:
    """Poses and keypoints of the built-in estimator, for the other baselines and `gmrdata tables`.

    It stands where the paper has VIBE and STAF (docs/poses.md says how good it is).
    """
    from gmrdata.paper.own_poses import own_poses
    from gmrdata.people.following import Networks

    made = own_poses(
        manifest,
        out,
        body_path=flags.body_path(body),
        networks=Networks.find(detector, landmark_network),
        run=Run(redo=redo),
    )
    answer(made)


def baseline(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("zero", constructor=baseline_zero)]
        | Annotated[Any, subcommand("mean", constructor=baseline_mean)]
        | Annotated[Any, subcommand("camera_as_world", constructor=baseline_camera_as_world)]
        | Annotated[Any, subcommand("vibe_cam", constructor=baseline_vibe_cam)]
        | Annotated[Any, subcommand("own_poses", constructor=baseline_own_poses)]
        | Annotated[Any, subcommand("joint_train", constructor=baseline_joint_train)]
        | Annotated[Any, subcommand("joint", constructor=baseline_joint)]
    ],
) -> None:
    """Predict a manifest's world motions with what GMR is compared with."""
