"""Recipes of the network, its loss, its training windows and its training; and where networks lie.

Needs no torch.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gmrdata.values import limits
from gmrdata.values.records import Config

Representation = Literal["quaternion", "axis-angle", "6d"]  # of rotations in and out
ExtraInput = Literal["velocity", "standing", "feet"]
"""Functions of the local rotations that are given beside them (gmrdata.gmr.model)."""
MotionSource = Literal["regressed", "standing_joint"]
"""Where dR or dT comes from: the last layer, the paper's way, or also the joint that stands."""
Which = Literal["latest", "best"]  # a run's last step so far, or what scored best up to it


class NetworkConfig(Config):
    """Size of a network, and how it puts out a motion."""

    layers: int = Field(default=4, ge=1, le=limits.MOST_LAYERS)
    """Bidirectional GRU layers; the paper's 4."""
    hidden: int = Field(default=2048, ge=1, le=limits.MOST_UNITS)
    """Units per direction; the paper's 2048."""
    latent: int | None = Field(default=None, ge=1, le=limits.MOST_UNITS)
    """Numbers of the latent feature F_i that the linear projection makes; None for as many as
    `hidden`.  Fig. 4 has 2048; the paper doesn't say whether smaller GRUs (Table 9) have fewer."""
    output: Representation = "axis-angle"  # of dR; the paper's vector makes 6 outputs with dT
    dropout: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of features dropped between GRU layers and before the last; not the paper's."""
    output_scale: float = Field(default=1.0, gt=0.0, le=1e6)
    """Factor on the last layer's output; the paper's 1.  Motions at 10 fps are about 0.1 rad, m."""

    @property
    def n_features(self) -> int:
        return self.hidden if self.latent is None else self.latent

    @model_validator(mode="after")
    def _can_be_held(self) -> Self:
        """Three matrices of each GRU, in each direction; the last layers have fewer weights."""
        inputs = self.n_features + 2 * self.hidden * (self.layers - 1)
        if 6 * self.hidden * (inputs + self.layers * self.hidden) > limits.MOST_WEIGHTS:
            what = f"hidden {self.hidden} in {self.layers} layers"
            raise ValueError(f"{what} are more than {limits.MOST_WEIGHTS} weights; take fewer")
        return self


class ModelConfig(NetworkConfig):
    """Size and representations of a GMR."""

    input: Representation = "quaternion"  # of the 23 local rotations; the paper's 92 numbers
    extra_inputs: tuple[ExtraInput, ...] = ()
    """What else is given; the paper has none.  `velocity`: how each joint turns to the next frame,
    69 numbers.  `standing`: the root's motion if that joint stood still, for each, 138 numbers.
    `feet`: what each foot sees of the body, 60 numbers."""
    looks_at: Literal["all_joints", "legs_and_trunk"] = "all_joints"
    """Whose rotations and extra inputs the GRUs get.  Arms and head move in more ways than a small
    set of people shows, and carry nobody; joints that stand are found among all in either case."""
    rotation: MotionSource = "regressed"
    """How dR is put out.  `standing_joint`: as the turn that the joint that stands leaves to the
    root, after what is regressed; the network says which one stands."""
    translation: MotionSource = "regressed"
    """How dT is put out.  `standing_joint`: as what the joint that stands leaves to the root, given
    dR, and what is regressed; perhaps another joint: a foot that turns on its ball stands."""
    joints_say: bool = False
    """Whether how each joint itself moves says, too, if it stands, by weights that joints share,
    and a body in flight is held as one more joint (`gmrdata.gmr.supports`).  Needs `standing_joint`
    for both."""
    regressed: Literal["freely"] = "freely"
    """Nothing else.  The key stays, since networks that are trained have it in their records."""
    symmetric: bool = False
    """Whether a trained network's answer is the mean of four: to the sequence, its mirror image,
    its reverse, and both, each turned back.  That takes four times as long; training is the same.
    """
    soles_hold: bool = False
    """Whether soles that stand hold a trained network's answer (`gmrdata.gmr.soles`); training is
    the same."""

    @model_validator(mode="after")
    def _joints_can_say(self) -> Self:
        if self.joints_say and {self.rotation, self.translation} != {"standing_joint"}:
            raise ValueError("joints_say needs rotation and translation: standing_joint")
        return self


class LossConfig(Config):
    """Eq. 5: its weights w_ori, w_trans, w_vertex and w_smooth, and readings of it."""

    orientation: float = Field(default=1.0, ge=0.0)
    translation: float = Field(default=1.0, ge=0.0)
    vertex: float = Field(default=1.0, ge=0.0)
    smoothness: float = Field(default=1e-2, ge=0.0)
    orientation_loss: Literal["chordal", "angular", "axis-angle"] = "chordal"
    """Eq. 10, 9 or 11.  The paper ends with chordal (its Table 2)."""
    error: Literal["squared", "length"] = "squared"
    """Of orientation and translation: squared as in the paper, or their lengths, of which OME and
    TME are means.  A few motions that cannot be foreseen then count for less."""
    reduction: Literal["mean", "sum"] = "mean"
    """`mean` over motions (and vertices), or `sum` as eqs. 9-14 are written and then the mean over
    the windows of a batch, about which the paper says nothing.  The recipes of the paper say `sum`;
    then one metre of translation weighs as much as one metre at one of the body's vertices."""
    n_vertices: int | None = Field(default=None, ge=1)
    """Vertices that the vertex term looks at, evenly spread over the body's list; None for all, as
    in the paper.  With `sum`, a subset is scaled up to the whole body."""


class WindowConfig(Config):
    """How training windows are cut."""

    frames: int = Field(default=64, ge=2, le=limits.MOST_FRAMES)
    """Of a window; the paper's 64.  Shorter runs are padded."""
    fps_hz: float = Field(default=10.0, ge=0.1, le=1000.0)
    """Of the network's input [Hz]; the paper's 10."""
    reverse_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of windows played backwards: the paper's flip augmentation, which uses both kinds."""
    all_phases: bool = True
    """Whether a clip of k times the rate gives k sequences, each begun a frame later, or only the
    first.  The paper samples "each sequence at a rate of 10 fps", plainly read: once."""
    mirror_probability: float = Field(default=0.0, ge=0.0, le=1.0)  # of left and right; paper: 0
    pose_noise_deg: float = Field(default=0.0, ge=0.0, le=180.0)
    """Root mean square angle of random turns of each joint, in the input alone [deg]; paper: 0."""
    jitter_deg: float = Field(default=0.0, ge=0.0, le=180.0)
    """Most root mean square angle of further turns, anew in each frame, as poses of pictures have
    them: each window has a random share of it [deg]; paper: 0."""
    pose_noise_time_s: float = Field(default=0.0, ge=0.0, le=limits.LONGEST_S)
    """Standard deviation of the Gaussian that smooths them in time [s]; 0: anew in each frame."""


class DataConfig(Config):
    """Which clips of the manifests are trained on, and how often."""

    weights: tuple[Annotated[float, Field(gt=0.0)], ...] | None = None
    """Share of the windows from each manifest, in order and up to a factor; None: by its frames."""
    balance: float = Field(default=1.0, ge=0.0, le=1.0)
    """How often windows are of each person of a manifest: by the number of frames to this power.  1
    by the frames, as the paper has it; 0 for all people alike."""
    held_out_subjects: tuple[int | str, ...] = ()
    """People who are scored while training, not trained on: 2 for CMU's subject 02, else data set
    and subject as in the manifest's source, like KIT/3 or Human3.6M/S9."""
    never_train_on: tuple[str, ...] = ("paper_table8",)
    """Published lists whose sequences are left out: the CMU trials on which the paper scores."""


class StepsConfig(Config):
    """What trainings of any network have in common."""

    learning_rate: float = Field(default=5e-5, gt=0.0)  # Adam's step size; the paper's 5e-5
    gradient_norm: float | None = Field(default=None, gt=0.0)
    """Longest gradient, clipped beyond; None for no limit, of which the paper says nothing."""
    batch_size: int = Field(default=32, ge=1, le=limits.MOST_BATCH)
    """Windows per step and process, so N processes have N times as many; the paper's 32."""
    steps: int = Field(default=100_000, ge=1, le=limits.MOST_STEPS)
    """The paper doesn't say how many."""
    seed: int = Field(default=0, ge=0, le=limits.LARGEST_SEED)
    """Of the initial weights, the windows and the dropout."""
    log_every: int = Field(default=10, ge=1)  # steps between lines of metrics.jsonl
    checkpoint_every: int = Field(default=1000, ge=1)  # steps; a stopped run goes on from there
    threads: int = Field(default=1, ge=1, le=limits.MOST_WORKERS)
    """On the CPU; another number rounds sums in another way."""
    device: Literal["cpu", "cuda"] = "cpu"  # bitwise repetition is promised on the CPU


class TrainConfig(StepsConfig):
    """A training run.  The defaults are the paper's (section 4.1) where it states one, except for
    `loss.reduction` and `windows.all_phases`.  Recipe `gmr` has all of the paper's, for a GPU."""

    model: ModelConfig = ModelConfig()
    loss: LossConfig = LossConfig()
    windows: WindowConfig = WindowConfig()
    data: DataConfig = DataConfig()
    schedule: Literal["constant", "cosine"] = "constant"
    """Step size over time: constant (the paper states no schedule), or down to 0 along a cosine."""
    warmup_steps: int = Field(default=0, ge=0)  # the step size rises from 0; the paper states none
    average_decay: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of the former value that an exponential moving average of the weights keeps in a step,
    but at most (1 + step) / (10 + step), so that it forgets where it began.  The average is then
    what is scored and used; 0 for the weights themselves, as in the paper."""
    eval_every: int = Field(default=1000, ge=1)  # steps between scores on held-out clips
    precision: Literal["fp32", "bf16"] = "fp32"
    """Numbers that the network computes with: `bf16` by autocast; the rest stays in float32."""
    compile: bool = False  # the network by `torch.compile`; the GRUs stay the library's own
    tensorboard: bool = False  # event files beside metrics.jsonl; needs the extra `tensorboard`

    @model_validator(mode="after")
    def _batch_can_be_held(self) -> Self:
        check_batch(self.batch_size, self.windows.frames)
        return self


def check_batch(batch_size: int, n_frames: int) -> None:
    """ValueError, for a validator, where a step's windows have too many frames in all."""
    if batch_size * n_frames > limits.MOST_BATCH_FRAMES:
        what = f"batch_size {batch_size} of windows of {n_frames} frames"
        raise ValueError(f"{what} are more than {limits.MOST_BATCH_FRAMES} frames; take fewer")


BUNDLED = "bundled"
"""The word for the network that the package brings.  `card.md` beside its weights says what it was
trained on, and how it scores."""
BUNDLE_FILE = "bundle.json"  # in a folder of weights alone


def network_dir(network: Path | str) -> Path:
    """The folder of a network: the package's own for the word `bundled`."""
    return Path(__file__).with_name("weights") if str(network) == BUNDLED else Path(network)


def weights_dir(network_dir: Path) -> Path:
    """What decides the motions of a network's folder: the checkpoints of a run, beside which its
    measured errors and results may lie, or all of a folder of weights alone."""
    kept = network_dir / "checkpoints"
    is_run = kept.is_dir() and not (network_dir / BUNDLE_FILE).is_file()
    return kept if is_run else network_dir


def is_network(path: Path | str) -> bool:
    """Whether a path, or the word `bundled`, is a network's."""
    folder = network_dir(path)
    return (folder / BUNDLE_FILE).is_file() or (folder / "checkpoints").is_dir()
