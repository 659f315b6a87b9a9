"""Networks to use, and the world motion that they see in a local pose sequence.

A network is a run's folder, or a folder of weights alone, like the one in the package: that holds
`bundle.json` and a safetensors file for each network, in float16.  Rounding a weight by 0.05 %
changes a motion by far less than two trainings differ.  Several networks predict together
(`MeanGmr`).
"""

import io
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import torch
from pydantic import Field
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

from gmrdata import __version__
from gmrdata.gmr.augmentation import mean_motion
from gmrdata.gmr.checkpoint import (
    REMEDY,
    brought_up_model,
    read_model,
    read_network,
    read_state,
    trained_checkpoint,
)
from gmrdata.gmr.config import BUNDLE_FILE, ModelConfig, Which, network_dir
from gmrdata.gmr.model import Gmr, MeanGmr, given_input
from gmrdata.gmr.rotations import Answer
from gmrdata.gmr.runs import runs_at
from gmrdata.gmr.soles import held_by_soles
from gmrdata.motion.resample import resample
from gmrdata.values import limits
from gmrdata.values.body import JOINT_NAMES, N_LOCAL, require_local
from gmrdata.values.clip import Clip
from gmrdata.values.errors import BadCheckpoint, BadMotionFile, BadRecord, MissingExtra
from gmrdata.values.files import read_json
from gmrdata.values.motion import Motion, accumulate, deltas, without_root
from gmrdata.values.records import Record
from gmrdata.values.shapes import Float
from gmrdata.values.transforms import are_rotations


class Bundle(Record):
    """`bundle.json`."""

    format: Literal["gmrdata-networks/1"] = "gmrdata-networks/1"
    name: str
    model: ModelConfig
    fps_hz: float = Field(gt=0)
    body: str
    step: int = Field(ge=0)
    networks: int = Field(ge=1, le=limits.MOST_NETWORKS)
    """How many; their files are `network_0.safetensors` and so on."""


@dataclass(frozen=True, eq=False)
class TrainedGmr:
    """A network in evaluation mode, with what it takes to use it."""

    model: Gmr | MeanGmr
    fps_hz: float  # frame rate that it was trained at
    name: str  # of the run's folder, or the bundle's own
    step: int  # training steps behind the weights


def load_gmr(network: Path | str, which: Which = "latest") -> TrainedGmr:
    """The latest checkpoint of a training run, or what scored best on its held-out clips.

    Or a folder of weights alone, which has no other weights; `bundled` is the package's own.
    MissingInput where there is none, BadCheckpoint where it is broken or has no such weights.
    """
    folder = network_dir(network)
    if which not in get_args(Which):
        raise BadCheckpoint(f"{folder}: no {which!r} weights; take {' or '.join(get_args(Which))}")
    if (folder / BUNDLE_FILE).is_file():
        if which == "best":
            raise BadCheckpoint(f"{folder}: has the latest weights alone. Use those")
        bundle, bundled = read_bundle(folder)
        return TrainedGmr(bundled.eval(), bundle.fps_hz, bundle.name, bundle.step)
    kept = trained_checkpoint(folder)
    state, model = read_state(kept), read_model(kept, which).eval()
    step = state.best.step if which == "best" and state.best is not None else state.step
    return TrainedGmr(model, state.fps_hz, folder.resolve().name, step)


def read_bundle(folder: Path) -> tuple[Bundle, Gmr | MeanGmr]:
    """A folder's record and its network; BadCheckpoint where something is broken or missing."""
    path = folder / BUNDLE_FILE
    try:
        value = read_json(path)
        if isinstance(value, dict):  # as `write_bundle` of a former version left it
            value["model"] = brought_up_model(value.get("model"))
        bundle = Bundle.of_value(path, value)
    except BadRecord as error:
        raise BadCheckpoint(f"{error}. {REMEDY}") from None
    models = [read_network(folder, f"network_{i}", bundle.model) for i in range(bundle.networks)]
    return bundle, models[0] if len(models) == 1 else MeanGmr(models)


Deltas = tuple[Float[np.ndarray, "frames-1 3 3"], Float[np.ndarray, "frames-1 3"]]
"""dR and dT [m] between poses."""


def predict_deltas(gmr: TrainedGmr, local_rotmats: Float[np.ndarray, "frames 23 3 3"]) -> Deltas:
    """dR, orthonormal to float64, and dT [m] between local poses at the network's frame rate."""
    return held(gmr, local_rotmats, predict_with_doubt(gmr, local_rotmats)[:2], gmr.fps_hz)


class DoubtedMotions(NamedTuple):
    """Motions from each of T poses to the next, and how far a network's answers are apart."""

    delta_rotmats: Float[np.ndarray, "frames-1 3 3"]
    delta_m: Float[np.ndarray, "frames-1 3"]
    doubt: Float[np.ndarray, "frames-1 2"]
    """Of the turn and of the step, as rates [rad/s, m/s]."""


def predict_with_doubt(
    gmr: TrainedGmr, local_rotmats: Float[np.ndarray, "frames 23 3 3"]
) -> DoubtedMotions:
    """The same before soles hold it, and how far apart the answers are whose mean it is: those of a
    symmetric network and of several networks, root mean square; zeros for one answer."""
    given = torch.from_numpy(np.array(local_rotmats, np.float64, order="C"))
    poses = given_input(given, gmr.model.config)
    device = next(gmr.model.parameters()).device
    with torch.no_grad():
        answers = gmr.model.answers(poses.float()[None].to(device))
        mean = mean_motion(answers)
        apart = torch.stack([_apart(one, mean) for one in answers]).square().mean(0).sqrt()
        delta_rotmats, delta_m, doubt = (
            values[0, :-1].cpu().double().numpy() for values in (*mean, apart)
        )
    return DoubtedMotions(_orthonormal(delta_rotmats), delta_m, gmr.fps_hz * doubt)


def held(
    gmr: TrainedGmr, local_rotmats: Float[np.ndarray, "frames 23 3 3"], given: Deltas, fps_hz: float
) -> Deltas:
    """dR and dT [m] between poses of any rate, orthonormal; held by soles if these have a say."""
    delta_rotmats, delta_m = given
    if gmr.model.config.soles_hold:
        poses = torch.as_tensor(local_rotmats.astype(np.float64))
        tensors = torch.as_tensor(delta_rotmats), torch.as_tensor(delta_m)
        delta_rotmats, delta_m = (x.numpy() for x in held_by_soles(poses, tensors, fps_hz))
    return _orthonormal(delta_rotmats), delta_m


def _orthonormal(rotmats: np.ndarray) -> np.ndarray:
    """Rounding errors of float32 would grow over thousands of accumulated frames."""
    return Rotation.from_matrix(rotmats).as_matrix()


def _apart(one: Answer, mean: Answer) -> Tensor:
    """The angle between two dR, and the length between two dT: (batch, frames, 2)."""
    # The chord of a small angle, which has no root of a rounding error.
    angles = (one[0] - mean[0]).square().sum((-1, -2)).div(2).sqrt()
    return torch.stack([angles, (one[1] - mean[1]).norm(dim=-1)], dim=-1)


def predict_world_motion(
    gmr: TrainedGmr,
    motion: Motion,
    *,
    first_root_rotmat: Float[np.ndarray, "3 3"] | None = None,
    first_pelvis_m: Float[np.ndarray, "3"] | None = None,
) -> Motion:
    """World motion of a person from the local pose alone, by eqs. 3-4 (paper, section 3.6).

    The motion's own root is not looked at.  With the paper's first pose, the identity, the world is
    the body's own frame at the first moment (x to its left, y up, z to its front).  Give the first
    pose to have another world.  BadMotionFile for what is no pose, and for too few or slow frames.

    Args:
        motion: Two or more local poses, at the network's frame rate or above, to be resampled.
        first_root_rotmat: R_1, world_from_root; the identity if None.
        first_pelvis_m: T_1 [m]; the origin if None.
    """
    root = np.asarray(np.eye(3) if first_root_rotmat is None else first_root_rotmat, np.float64)
    place_m = np.asarray(np.zeros(3) if first_pelvis_m is None else first_pelvis_m, np.float64)
    is_place = place_m.shape == (3,) and np.isfinite(place_m).all()
    if not (is_place and root.shape == (3, 3) and are_rotations(root)):
        what = "the first pose is no rotation (3, 3) and place (3,). Give those of a valid frame"
        raise BadMotionFile(f"{motion.source}: {what}")
    local = _at_network_rate(gmr, motion)
    root_rotmats, pelvis_m = accumulate(*predict_deltas(gmr, local.local_rotmats), root, place_m)
    source = f"world motion predicted by GMR {gmr.name} (step {gmr.step}) from: {motion.source}"
    if abs(motion.fps_hz - gmr.fps_hz) > 1e-6 * gmr.fps_hz:
        source += f", resampled from {motion.fps_hz:g} to {gmr.fps_hz:g} fps"
    return replace(
        local, root_rotmats=root_rotmats, pelvis_m=pelvis_m, frame="world", source=source
    )


def _at_network_rate(gmr: TrainedGmr, motion: Motion) -> Motion:
    """The motion at the network's rate, without its roots, which may be absent."""
    require_local(motion)
    n = motion.n_frames
    clip = Clip(motion.source, without_root(motion), np.ones(n, bool), np.full(n, -1), None)
    runs = runs_at(clip, gmr.fps_hz, all_phases=False)
    if not runs:
        what = f"{n} frames at {motion.fps_hz:g} fps are less than two frames at"
        raise BadMotionFile(f"{motion.source}: {what} {gmr.fps_hz:g} fps. Give a longer motion")
    return runs[0]


def deltas_at_source_rate(gmr: TrainedGmr, motion: Motion) -> DoubtedMotions:
    """dR (T-1, 3, 3) and dT (T-1, 3) [m] between all T poses, from the local ones alone, before
    soles hold them: feet that stand are evidence of their own.

    The network runs at its own rate, mostly 10 Hz, over poses of 30.  Begun one pose later it sees
    the same motion in another phase; from pose to pose the mean of all phases is taken.  A last
    pose beyond the network's last moment goes on as the one before it did.  BadMotionFile where the
    poses are fewer than two at the network's rate.
    """
    n = motion.n_frames
    turns, steps_m, counts = np.zeros((n - 1, 3)), np.zeros((n - 1, 3)), np.zeros((n - 1, 1))
    doubts = np.zeros((n - 1, 2))
    for phase in range(max(1, int(motion.fps_hz / gmr.fps_hz + 1e-6))):
        if phase and (n - 1 - phase) / motion.fps_hz < 1 / gmr.fps_hz - 1e-6:
            break
        local = _at_network_rate(gmr, motion.take(slice(phase, None)))
        turned, moved_m, doubt = predict_with_doubt(gmr, local.local_rotmats)
        root_rotmats, pelvis_m = accumulate(turned, moved_m, np.eye(3), np.zeros(3))
        path = replace(
            local, root_rotmats=root_rotmats, pelvis_m=pelvis_m, frame="world",
            local_rotmats=local.local_rotmats[:, :0],
        )  # fmt: skip
        back = resample(path, motion.fps_hz)
        delta_rotmats, delta_m = deltas(back.root_rotmats, back.pelvis_m)
        rows = slice(phase, min(phase + len(delta_rotmats), n - 1))
        count = rows.stop - phase
        turns[rows] += Rotation.from_matrix(delta_rotmats[:count]).as_rotvec()
        steps_m[rows] += delta_m[:count]
        of_motion = (np.arange(count) * gmr.fps_hz / motion.fps_hz).astype(int)
        doubts[rows] += doubt[of_motion.clip(max=len(doubt) - 1)]
        counts[rows] += 1
    nearest = np.maximum.accumulate(np.where(counts[:, 0] > 0, np.arange(n - 1), 0))
    turns, steps_m, doubts = (
        (values / np.maximum(counts, 1))[nearest] for values in (turns, steps_m, doubts)
    )
    return DoubtedMotions(Rotation.from_rotvec(turns).as_matrix(), steps_m, doubts)


OPSET = 17
INPUT, OUTPUTS = "local_rotmats", ("delta_rotmats", "delta_m")
ABOUT = {
    INPUT: "(batch, frames, 23, 3, 3) float32: parent_from_joint rotations of the joints in"
    " `joints`, relative to SMPL's T-pose, two or more frames at `fps_hz`",
    OUTPUTS[0]: "(batch, frames - 1, 3, 3) float32: dR = R_i^T R_{i+1} of the root, in the root's"
    " frame; R_{i+1} = R_i dR",
    OUTPUTS[1]: "(batch, frames - 1, 3) float32: dT = R_i^T (T_{i+1} - T_i) of the pelvis [m];"
    " T_{i+1} = T_i + R_i dT",
}
"""What goes in and out."""


class _WholeNetwork(nn.Module):
    """From local rotations to the T - 1 motions between T frames."""

    def __init__(self, gmr: TrainedGmr) -> None:
        super().__init__()
        self.gmr, self.model = gmr, gmr.model

    def forward(
        self, local_rotmats: Float[Tensor, "batch frames 23 3 3"]
    ) -> tuple[Float[Tensor, "batch frames-1 3 3"], Float[Tensor, "batch frames-1 3"]]:
        delta_rotmats, delta_m = self.model(given_input(local_rotmats, self.model.config))
        motions = delta_rotmats[:, :-1], delta_m[:, :-1]
        if self.model.config.soles_hold:
            motions = held_by_soles(local_rotmats, motions, self.gmr.fps_hz)
        return motions


def onnx_network(gmr: TrainedGmr) -> bytes:
    """The model file of a network, opset 17, float32, for any batch and two or more frames.

    All sequences of a batch have the same length.  MissingExtra where onnx is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise MissingExtra(f"an ONNX model needs onnx ({error}): pip install onnx") from None
    example = torch.eye(3).expand(2, 5, N_LOCAL, 3, 3).contiguous()
    stream = io.BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        # On the exporter's age; on shapes that it writes down as constants, which tests look at.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            _WholeNetwork(gmr).eval(),  # the exporter puts back the mode that it finds
            (example,),
            stream,  # type: ignore[arg-type]  # its older form takes streams too
            dynamo=False,
            opset_version=OPSET,
            input_names=[INPUT],
            output_names=list(OUTPUTS),
            dynamic_axes={INPUT: {0: "batch", 1: "frames"}}
            | {name: {0: "batch", 1: "motions"} for name in OUTPUTS},
        )
    model = onnx.load_from_string(stream.getvalue())
    del model.graph.value_info[:]  # its idea of shapes in between
    for output in model.graph.output:
        for dim in output.type.tensor_type.shape.dim[2:]:
            dim.dim_value = 3
    model.producer_name, model.producer_version = "gmrdata", __version__
    onnx.helper.set_model_props(model, _metadata(gmr))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def _metadata(gmr: TrainedGmr) -> dict[str, str]:
    """What a user must know, as texts by name."""
    return {
        "gmrdata_version": __version__,
        "run": gmr.name,
        "step": str(gmr.step),
        "fps_hz": f"{gmr.fps_hz:.17g}",
        "joints": ",".join(JOINT_NAMES[1:]),
        "network": gmr.model.config.model_dump_json(),
        **ABOUT,
    }
