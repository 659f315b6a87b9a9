"""The verb for what GMR is compared with."""

from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import OmitSubcommandPrefixes, Positional, subcommand

from gmrdata.cli.answers import answer
from gmrdata.cli.options import body_path, need
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe


def baseline_zero(manifest: Positional[Path], out: Path, redo: bool = False) -> None:
    """Zero motion: everybody stays in the pose of the first frame.

    Args:
        manifest: Manifest file.
        out: Output folder: predictions/ with a clip file for each clip, predictions.json.
        redo: Throw away a result of other inputs.
    """
    from gmrdata.baselines.zero import predict_zero

    answer(predict_zero(manifest, out, run=Run(redo=redo)))


def baseline_mean(
    manifest: Positional[Path],
    training: tuple[Path, ...],
    out: Path,
    fps_hz: float = 10.0,
    redo: bool = False,
) -> None:
    """Mean motion: everybody repeats the mean dR and dT of training clips.

    Args:
        manifest: Manifest file.
        training: Manifests whose motions are averaged.
        out: Output folder: predictions/ with a clip file for each clip, predictions.json.
        fps_hz: Frame rate at which motions are averaged [Hz].
        redo: Throw away a result of other settings.
    """
    from gmrdata.baselines.mean import MeanConfig, predict_mean

    need(training, "a manifest to average: --training")
    answer(predict_mean(manifest, training, out, MeanConfig(fps_hz=fps_hz), run=Run(redo=redo)))


def baseline_camera_as_world(
    manifest: Positional[Path],
    out: Path,
    camera: Literal["ignored", "true", "recovered"] = "ignored",
    cameras: Path | None = None,
    redo: bool = False,
) -> None:
    """True poses in the camera's frame, taken as world poses: the camera's motion is ignored.

    Args:
        manifest: Manifest file.
        out: Output folder: predictions/ with a clip file for each clip, predictions.json.
        camera: ignored; or, as the reference that knows the camera, true or recovered.
        cameras: For recovered cameras: a folder with <clip id>/ as `gmrdata sfm --out` makes it.
        redo: Throw away a result of other settings.
    """
    from gmrdata.baselines.camera_as_world import CameraAsWorldConfig, predict_camera_as_world

    config = CameraAsWorldConfig(camera=camera)
    answer(predict_camera_as_world(manifest, out, config, cameras_dir=cameras, run=Run(redo=redo)))


def baseline_vibe_cam(
    manifest: Positional[Path],
    poses: Path,
    keypoints: Path,
    out: Path,
    person: tuple[str, ...] = (),
    image_size: tuple[int, int] | None = None,
    body: str = "anny",
    redo: bool = False,
) -> None:
    """VIBE-CAM: another network's camera-frame poses, placed by 2D keypoints, taken as world poses.

    Args:
        manifest: Manifest file; of its clips, only the camera's intrinsics are used.
        poses: Folder with <clip id>.npz: clip files in the camera's frame, without translation.
        keypoints: Folder with <clip id>/ of OpenPose's or STAF's JSON, one file per frame.
        out: Output folder: predictions/ with a clip file for each clip, predictions.json.
        person: Tracks of STAF to follow, like walk_01=3. Other clips take the most confident person
            of each frame.
        image_size: Width and height of the images that the detector was given [px]; the camera's
            when left out.
        body: "anny", or the path of the poses' body model.
        redo: Throw away a result of other settings.
    """
    from gmrdata.baselines.vibe_cam import VibeCamConfig, predict_vibe_cam

    config = VibeCamConfig(person_ids=_tracks(person), image_size_px=image_size)
    answer(
        predict_vibe_cam(
            manifest, poses, keypoints, out, config, body_path=body_path(body), run=Run(redo=redo)
        )
    )


def baseline_joint_train(
    manifests: Positional[tuple[Path, ...]],
    features: Path,
    out: Path,
    recipe: Path | None = None,
    body: str = "anny",
    redo: bool = False,
) -> None:
    """Train the non-sequential model: local pose and world motion together from image features.

    Args:
        manifests: Manifest files with clips to train on.
        features: Folder with <clip id>.npz that hold `features` (T, D), a row for each row.
        out: Run folder.
        recipe: A recipe file of kind `joint`; the defaults (GMR's) when left out.
        body: "anny", or the path of the clips' body model.
        redo: Throw away a run of another recipe.
    """
    from gmrdata.baselines.joint_config import JointConfig
    from gmrdata.baselines.joint_train import train_joint
    from gmrdata.stage.recipes import load_recipe

    need(manifests, "a manifest file")
    config = JointConfig() if recipe is None else load_recipe(recipe, JointConfig)
    answer(
        train_joint(manifests, features, out, config, body_path=body_path(body), run=Run(redo=redo))
    )


def baseline_joint(
    run: Positional[Path],
    manifest: Positional[Path],
    features: Path,
    out: Path,
    redo: bool = False,
) -> None:
    """What a trained non-sequential model sees in a manifest's image features.

    Args:
        run: Run folder of `gmrdata baseline joint_train`.
        manifest: Manifest file.
        features: Folder with <clip id>.npz that hold `features` (T, D), a row for each row.
        out: Output folder: predictions/ with a clip file for each clip, predictions.json.
        redo: Throw away a result of other inputs.
    """
    from gmrdata.baselines.joint_predict import predict_joint

    answer(predict_joint(run, manifest, features, out, run=Run(redo=redo)))


def _tracks(person: tuple[str, ...]) -> dict[str, int]:
    """`walk_01=3` as {"walk_01": 3}."""
    tracks = {}
    for text in person:
        clip_id, equals, number = text.rpartition("=")
        if not equals or not number.isdecimal():
            raise BadRecipe(f"--person {text}: expected the clip's id, =, and a number")
        tracks[clip_id] = int(number)
    return tracks


def baseline(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("zero", constructor=baseline_zero)]
        | Annotated[Any, subcommand("mean", constructor=baseline_mean)]
        | Annotated[Any, subcommand("camera_as_world", constructor=baseline_camera_as_world)]
        | Annotated[Any, subcommand("vibe_cam", constructor=baseline_vibe_cam)]
        | Annotated[Any, subcommand("joint_train", constructor=baseline_joint_train)]
        | Annotated[Any, subcommand("joint", constructor=baseline_joint)]
    ],
) -> None:
    """Predict a manifest's world motions with what GMR is compared with."""
