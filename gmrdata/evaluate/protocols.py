"""Named protocols: what other systems measure in the world, and how each differs, as plain data.

Each entry says which public code it follows; `notes` say where it can't, or must not, be followed
to the letter.  The protocols agree in this: positions are of SMPL's tree in metres, alignments are
least squares (Umeyama 1991), and published figures are of video at 30 fps.
"""

from dataclasses import dataclass
from typing import Literal

from gmrdata.body.tree import JOINT, N_JOINTS
from gmrdata.evaluate.protocol_names import ProtocolName
from gmrdata.evaluate.world_metrics import Remainder

WorldMetric = Literal[
    "w_mpjpe_mm",
    "wa_mpjpe_mm",
    "rte_percent",
    "roe_deg",
    "erve_mm_per_frame",
    "jitter_10m_per_s3",
    "foot_sliding_mm",
]


@dataclass(frozen=True)
class Protocol:
    """What is measured beside OME, TME and VME, and how."""

    name: ProtocolName
    """Its name on the command line."""
    metrics: tuple[WorldMetric, ...]
    """What it measures."""
    source: str
    """Repository and files that it follows."""
    notes: tuple[str, ...]
    """What a reader of the figures must know, as sentences."""
    fps_hz: float = 30.0
    """Rate of the published figures [Hz]."""
    segment_frames: int = 100
    """Frames of a segment of W-MPJPE and WA-MPJPE."""
    remainder: Remainder = "own_segment"
    """What becomes of frames after the last full segment."""
    first_frames: int = 2
    """Frames whose joints W-MPJPE aligns."""
    scale: bool = True
    """Whether W-MPJPE and WA-MPJPE fit the scale too."""
    joints: tuple[int, ...] = tuple(range(N_JOINTS))
    """Joints of W-MPJPE and WA-MPJPE."""
    sample: Literal["frame", "segment", "clip"] = "frame"
    """What each value stands for, of which the mean over all clips is taken."""
    zeroed_joints: tuple[int, ...] = ()
    """Joints that count as standing still in jitter, and so lower its mean."""
    jitter_of_path: bool = True
    """Whether jitter is of joints in the world; of joints relative to the pelvis otherwise."""
    contact_m: float = 0.01
    """A true point of a foot stands while it moves less than this from frame to frame [m]."""


_WHAM_NOTES = (
    "Released code joins the frames on both sides of a gap; here no velocity, jitter, sliding or "
    "path length goes over one.",
    "W-MPJPE and WA-MPJPE fit the scale, so they don't show an error of it; RTE does.",
)

_LSP_JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)  # fmt: skip

_EMDB_ZEROED = (
    "pelvis", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip

PROTOCOLS: dict[ProtocolName, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            name="gmr",
            metrics=(),
            source="the GMR paper (arXiv 2112.00343), eqs. 15-17 and fig. 5",
            notes=("OME, TME, VME and the vertex error over time; nothing is aligned.",),
            fps_hz=10.0,
        ),
        Protocol(
            name="wham",
            metrics=(
                "w_mpjpe_mm",
                "wa_mpjpe_mm",
                "rte_percent",
                "roe_deg",
                "erve_mm_per_frame",
                "jitter_10m_per_s3",
                "foot_sliding_mm",
            ),
            source="yohanshin/WHAM, lib/eval/eval_utils.py and lib/eval/evaluate_emdb.py",
            notes=(
                *_WHAM_NOTES,
                "The released code has no ROE and no ERVE. ROE is taken after the first frame's "
                "orientations were made equal, ERVE as yufu-wang/tram codes it.",
                "RTE is of SMPL's transl there and of the pelvis here; the two paths differ by a "
                "constant, which the alignment takes away.",
            ),
        ),
        Protocol(
            name="tram",
            metrics=("w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent", "erve_mm_per_frame"),
            source="yufu-wang/tram, lib/utils/eval_utils.py and scripts/emdb/run_eval.py",
            notes=(
                *_WHAM_NOTES,
                "Frames after the last full segment belong to it, but for the very last one; "
                "sequences of up to 100 frames have no W-MPJPE and no WA-MPJPE, and where the "
                "length is a multiple of 100 the last 100 frames are not scored.",
                "There the predicted path is smoothed before it is scored; here it is scored as "
                "it is given.",
            ),
            remainder="joined_but_last_frame",
        ),
        Protocol(
            name="gvhmr",
            metrics=(
                "w_mpjpe_mm",
                "wa_mpjpe_mm",
                "rte_percent",
                "jitter_10m_per_s3",
                "foot_sliding_mm",
            ),
            source="zju3dv/GVHMR, hmr4d/utils/eval/eval_utils.py and "
            "hmr4d/model/gvhmr/callbacks/metric_emdb.py",
            notes=(
                *_WHAM_NOTES,
                "There the joints of both bodies are regressed from their meshes by the neutral "
                "SMPL model; here each body has its own joints.",
            ),
        ),
        Protocol(
            name="slahmr",
            metrics=("w_mpjpe_mm", "wa_mpjpe_mm"),
            source="vye16/slahmr, slahmr/eval/tools.py, slahmr/eval/run_eval.py (fa_jmse, ga_jmse) "
            "and slahmr/eval/split_egobody.py",
            notes=(
                "Each segment counts once, however many frames it has: figures are means of "
                "segments.",
                "Sequences are cut into segments of 100 frames, the rest belongs to the last one, "
                "and sequences of up to 100 frames have none; where no frame is left over, the "
                "last 200 frames are one segment.",
                "There the joints are Human3.6M's, regressed from the mesh by a file that is not "
                "free; here they are SMPL's of the same names, 14 without the root. Until commit "
                "f65c767 the root was aligned too, and its error was a figure of its own.",
                "Both fit the scale, so they don't show an error of it.",
            ),
            remainder="joined",
            joints=tuple(JOINT[name] for name in _LSP_JOINTS),
            sample="segment",
        ),
        Protocol(
            name="emdb",
            metrics=("jitter_10m_per_s3",),
            source="eth-ait/emdb, evaluation_metrics.py and evaluation_engine.py",
            notes=(
                "The jitter of EMDB's own evaluation: nine joints count as standing still, which "
                "makes it 15/24 of the mean of the others; the pelvis' translation is left out; "
                "each sequence counts once. One file there calls the unit km/s^3, the other "
                "10 m/s^3, which it is.",
                "The figures of others on EMDB 2 are those of protocol wham.",
                "Released code joins the frames on both sides of a gap; here no jitter goes over "
                "one.",
            ),
            sample="clip",
            zeroed_joints=tuple(JOINT[name] for name in _EMDB_ZEROED),
            jitter_of_path=False,
        ),
    )
}
"""By name."""
