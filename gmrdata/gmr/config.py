"""Recipes of the network, its loss, its training windows and its training.  Needs no torch."""

from typing import Annotated, Literal

from pydantic import Field

from gmrdata.values.records import Config

Representation = Literal["quaternion", "axis-angle", "6d"]
"""How a rotation is given to the network, or by it."""
ExtraInput = Literal["velocity", "standing"]
"""What the network may be given beside the local rotations, of which it is a function
(gmrdata.gmr.inputs)."""
MotionSource = Literal["regressed", "standing_joint"]
"""Where dR or dT comes from: from the last layer, the paper's way, or from the joint that stands
and the last layer (gmrdata.gmr.inputs)."""
Which = Literal["latest", "best"]
"""The network after a run's last step so far, or what scored best on held-out clips up to it."""


class ModelConfig(Config):
    """Size and representations of the network."""

    layers: int = Field(default=4, ge=1)
    """Bidirectional GRU layers; the paper's 4."""
    hidden: int = Field(default=2048, ge=1)
    """Units per direction, and size of the latent feature; the paper's 2048."""
    input: Representation = "quaternion"
    """Representation of the 23 local rotations; the paper's quaternions are 92 numbers."""
    extra_inputs: tuple[ExtraInput, ...] = ()
    """What else is given, made from the local rotations; the paper has none.  `velocity`: how each
    joint turns to the next frame, 69 numbers.  `standing`: for each joint, the motion that the root
    would make if that joint stood still, 138 numbers."""
    output: Representation = "axis-angle"
    """Representation of dR; the paper's axis-angle vector makes 6 outputs with dT."""
    rotation: MotionSource = "regressed"
    """How dR is put out.  `standing_joint`: as the turn that the joint that stands leaves to the
    root, after what is regressed; the network says which one stands."""
    translation: MotionSource = "regressed"
    """How dT is put out.  `standing_joint`: as what the joint that stands leaves to the root, given
    dR, and what is regressed.  The joint may be another one than for the rotation: a foot that
    turns on its ball stands, but does not keep its orientation."""
    dropout: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of features dropped in training between GRU layers and before the last; not the
    paper's."""
    output_scale: float = Field(default=1.0, gt=0.0)
    """Factor on the last layer's output; the paper has none (1).  Motions at 10 fps are about
    0.1 rad and 0.1 m, so 0.1 starts a short training with outputs of the right size."""


class LossConfig(Config):
    """Eq. 5: its weights w_ori, w_trans, w_vertex and w_smooth, and readings of it."""

    orientation: float = Field(default=1.0, ge=0.0)
    translation: float = Field(default=1.0, ge=0.0)
    vertex: float = Field(default=1.0, ge=0.0)
    smoothness: float = Field(default=1e-2, ge=0.0)
    orientation_loss: Literal["chordal", "angular", "axis-angle"] = "chordal"
    """Eq. 10, 9 or 11.  The paper ends with chordal (its Table 2)."""
    reduction: Literal["mean", "sum"] = "mean"
    """`mean`: each term is its mean over motions (and vertices), so weights mean the same for any
    window and body.  `sum`: as eqs. 9-14 are written, then the mean over the windows of a batch,
    about which the paper says nothing."""
    n_vertices: int | None = Field(default=None, ge=1)
    """Vertices that the vertex term looks at, evenly spread over the body's list; None for all, as
    in the paper.  With `sum`, a subset is scaled up to the whole body."""


class WindowConfig(Config):
    """How training windows are cut."""

    frames: int = Field(default=64, ge=2)
    """Frames of a window; the paper's 64.  Shorter runs are padded."""
    fps_hz: float = Field(default=10.0, gt=0.0)
    """Frame rate of the network's input [Hz]; the paper's 10."""
    reverse_probability: float = Field(default=0.5, ge=0.0, le=1.0)
    """Share of windows played backwards: the paper's flip augmentation, which uses both kinds."""
    mirror_probability: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of windows with left and right exchanged; the paper's 0."""
    pose_noise_deg: float = Field(default=0.0, ge=0.0)
    """Root mean square angle by which each joint is turned at random in the network's input, and
    there alone [deg]; the paper's 0."""
    pose_noise_time_s: float = Field(default=0.0, ge=0.0)
    """Time over which that noise stays alike: standard deviation of the Gaussian that smooths it
    [s]; 0 for noise that is anew in each frame."""


class DataConfig(Config):
    """Which clips of the manifests are trained on, and how often."""

    weights: tuple[Annotated[float, Field(gt=0.0)], ...] | None = None
    """Share of the windows that come from each manifest, in their order and up to a factor; None
    for its share of all frames.  Within a manifest, runs are drawn by their frames."""
    held_out_subjects: tuple[int | str, ...] = ()
    """People who are not trained on, but scored while training: 2 for CMU's subject 02, else data
    set and subject as in the manifest's source, like KIT/3 or Human3.6M/S9."""
    never_train_on: tuple[str, ...] = ("paper_table8",)
    """Published lists whose sequences are left out of every training: by default the CMU trials of
    the paper's synthetic set (its Table 8), on which it scores."""


class StepsConfig(Config):
    """What trainings of any network have in common."""

    learning_rate: float = Field(default=5e-5, gt=0.0)
    """Adam's step size; the paper's 5e-5."""
    gradient_norm: float | None = Field(default=None, gt=0.0)
    """Longest gradient, clipped beyond; None for no limit, of which the paper says nothing."""
    batch_size: int = Field(default=32, ge=1)
    """Windows per step and process; the paper's 32.  N processes (`torchrun`) train as one does
    with N times as many."""
    steps: int = Field(default=100_000, ge=1)
    """Steps; the paper doesn't say how many."""
    seed: int = Field(default=0, ge=0)
    """Of the initial weights, the windows and the dropout."""
    log_every: int = Field(default=10, ge=1)
    """Steps between lines of metrics.jsonl."""
    checkpoint_every: int = Field(default=1000, ge=1)
    """Steps between checkpoints, from which a run that was stopped goes on."""
    threads: int = Field(default=1, ge=1)
    """CPU threads; part of the recipe, since another number rounds sums in another way."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to train.  Bitwise repetition is promised on the CPU."""


class TrainConfig(StepsConfig):
    """A training run; the defaults are the paper's (section 4.1) where it states one."""

    model: ModelConfig = ModelConfig()
    loss: LossConfig = LossConfig()
    windows: WindowConfig = WindowConfig()
    data: DataConfig = DataConfig()
    schedule: Literal["constant", "cosine"] = "constant"
    """Step size over time: constant (the paper states no schedule), or down to 0 along a cosine."""
    warmup_steps: int = Field(default=0, ge=0)
    """Steps over which the step size rises from 0; the paper states none."""
    average_decay: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Share of the former value that an exponential moving average of the weights keeps in a step;
    the average is then what is scored and used.  0 for the weights themselves, as in the paper.
    In the first steps the share is less, (1 + step) / (10 + step), so that the average forgets
    where it began."""
    eval_every: int = Field(default=1000, ge=1)
    """Steps between scores on held-out clips, where such are given."""
    best_by: Literal["held_out_tme_mm", "held_out_ome_deg"] = "held_out_tme_mm"
    """The held-out score whose lowest value makes the weights that are kept as the best."""
    precision: Literal["fp32", "bf16"] = "fp32"
    """Numbers that the network computes with: `bf16` by autocast, with weights, loss and optimiser
    in float32.  The paper does not say; float32 was usual."""
    compile: bool = False
    """Whether `torch.compile` makes the network; the GRUs stay the library's own."""
    tensorboard: bool = False
    """Whether to write TensorBoard's event files beside metrics.jsonl; needs the extra
    `tensorboard`."""
