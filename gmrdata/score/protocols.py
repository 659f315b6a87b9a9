"""Named protocols: what other systems measure, and how each differs, as plain data.

Each entry says which public code it follows.  Where it does not follow it to the letter, `ORIGINAL`
has the released code's own way by a name; `notes` say the rest.  The protocols agree in this:
positions are in metres, alignments are least squares (Umeyama 1991), and published figures are of
video at 30 fps.
"""

from collections.abc import Sequence
from typing import Any

from gmrdata.score import Deviation, ProtocolMetric, ProtocolName
from gmrdata.score.records import Protocol
from gmrdata.values.body import JOINT, N_JOINTS
from gmrdata.values.errors import BadBodyFile, BadRecipe

_CAMERA: tuple[ProtocolMetric, ...] = (
    "pa_mpjpe_mm", "mpjpe_mm", "pve_mm", "accel_error_m_per_s2",
)  # fmt: skip

_USUAL: tuple[ProtocolMetric, ...] = (*_CAMERA, "w_mpjpe_mm", "wa_mpjpe_mm", "rte_percent")

_JITTER_AND_FEET: tuple[ProtocolMetric, ...] = ("jitter_10m_per_s3", "foot_sliding_mm")

_SCALE_NOTE = ("W-MPJPE and WA-MPJPE fit the scale, so they don't show an error of it; RTE does.",)

_TRIM_NOTE = "The first and the last sample of the acceleration's error are left out, as there."

LSP_JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)  # fmt: skip

_EMDB_ZEROED = (
    "pelvis", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip

_LSP_NOTE = (
    "There the joints are Human3.6M's, regressed from the mesh by a file that is not free; here "
    "they are SMPL's of the same names, 14 without the root, unless that file is given."
)


def _protocol(name: ProtocolName, **differences: Any) -> Protocol:
    """A protocol that is as most are, but for what is given."""
    usual = {
        "name": name,
        "fps_hz": 30.0,
        "segment_frames": 100,
        "remainder": "own_segment",
        "first_frames": 2,
        "scale": True,
        "joints": tuple(range(N_JOINTS)),
        "hips": (JOINT["left_hip"], JOINT["right_hip"]),
        "joints_from": "skeleton",
        "sample": "frame",
        "once_per_clip": (),
        "zeroed_joints": (),
        "jitter": "world",
        "contact_m": 0.01,
        "accel_trim": 0,
        "pve_from": "hips",
        "gaps": "kept",
        "camera": "any",
        "people": "apart",
        "smoothing_frames": 0.0,
        "original": (),
        "deviations": tuple(ORIGINAL[name]),
    }
    return Protocol.model_validate(usual | differences)


ORIGINAL: dict[ProtocolName, dict[Deviation, dict[str, Any]]] = {
    "gmr": {},
    "wham": {"gaps": {"gaps": "joined"}, "camera": {"camera": "own"}},
    "tram": {
        "gaps": {"gaps": "joined"},
        "camera": {"camera": "own"},
        "smoothing": {"smoothing_frames": 3.0},
    },
    "gvhmr": {"gaps": {"gaps": "joined"}, "camera": {"camera": "own"}},
    "slahmr": {"gaps": {"gaps": "joined"}, "people": {"people": "together"}},
    "emdb": {
        "gaps": {"gaps": "joined"},
        "camera": {"camera": "own", "jitter": "camera_from_pelvis"},
    },
    "vibe": {"gaps": {"gaps": "joined_over_clips"}, "camera": {"camera": "own"}},
}
"""What the released code of each does otherwise, by the name that switches it."""

DEVIATIONS: dict[Deviation, str] = {
    "gaps": "Released code joins the frames on both sides of a gap; here no velocity, "
    "acceleration, jitter, sliding or path length goes over one.",
    "camera": "Released code gets predictions in the camera's frame. Here one that is in the world "
    "alone, without a camera of its own, is turned so that its first orientation is the true one, "
    "and seen by the truth's camera.",
    "people": "There a segment is of the video's frames, and all people in it are aligned jointly, "
    "by the first two frames of the first of them where only the first frames are; here each "
    "person is alone, and segments are of the valid frames.",
    "smoothing": "There the predicted path is smoothed before it is scored (a Gaussian of 3 "
    "frames); here it is scored as it is given.",
}
"""What each means, for a reader of figures that were taken without it."""

PROTOCOLS: dict[ProtocolName, Protocol] = {
    protocol.name: protocol
    for protocol in (
        _protocol(
            "gmr",
            metrics=(),
            source="the GMR paper (arXiv 2112.00343), eqs. 15-17 and fig. 5",
            notes=("OME, TME, VME and the vertex error over time; nothing is aligned.",),
            fps_hz=10.0,
        ),
        _protocol(
            "wham",
            metrics=(*_USUAL, "roe_deg", "erve_mm_per_frame", *_JITTER_AND_FEET),
            source="yohanshin/WHAM, lib/eval/eval_utils.py and lib/eval/evaluate_emdb.py",
            notes=(
                *_SCALE_NOTE,
                "The released code has no ROE and no ERVE. ROE is taken after the first frame's "
                "orientations were made equal, ERVE as yufu-wang/tram codes it.",
                _TRIM_NOTE,
                "RTE is of SMPL's transl there and of the pelvis here; the two paths differ by a "
                "constant, which the alignment takes away.",
            ),
            accel_trim=1,
        ),
        _protocol(
            "tram",
            metrics=(*_USUAL, "erve_mm_per_frame", "ate_m", "ate_s_m"),
            source="yufu-wang/tram, lib/utils/eval_utils.py, scripts/emdb/run_eval.py and "
            "lib/vis/traj.py",
            notes=(
                *_SCALE_NOTE,
                "Frames after the last full segment belong to it, but for the very last one; "
                "sequences of up to 100 frames have no W-MPJPE and no WA-MPJPE, and where the "
                "length is a multiple of 100 the last 100 frames are not scored.",
                _TRIM_NOTE,
                "ATE and ATE-S are of the prediction's own camera over all frames that both have, "
                "each clip counts once. ATE fits the scale, ATE-S does not.",
            ),
            remainder="joined_but_last_frame",
            once_per_clip=("ate_m", "ate_s_m"),
            accel_trim=1,
        ),
        _protocol(
            "gvhmr",
            metrics=(*_USUAL, *_JITTER_AND_FEET),
            source="zju3dv/GVHMR, hmr4d/utils/eval/eval_utils.py and "
            "hmr4d/model/gvhmr/callbacks/metric_emdb.py",
            notes=(
                *_SCALE_NOTE,
                "There the joints of both bodies are regressed from their meshes by the neutral "
                "SMPL model; here each body has its own joints, unless a regressor is given.",
            ),
        ),
        _protocol(
            "slahmr",
            metrics=(
                "pa_mpjpe_mm",
                "w_mpjpe_mm",
                "wa_mpjpe_mm",
                "accel_length_error_mm_per_frame2",
            ),
            source="vye16/slahmr, slahmr/eval/tools.py, slahmr/eval/run_eval.py and "
            "slahmr/eval/split_egobody.py",
            notes=(
                "Each segment counts once, however many frames it has: figures are means of "
                "segments.",
                "Sequences are cut into segments of 100 frames, the rest belongs to the last one, "
                "and sequences of up to 100 frames have none; where no frame is left over, the "
                "last 200 frames are one segment.",
                _LSP_NOTE + " Until commit f65c767 the root was aligned too, and its error was a "
                "figure of its own.",
                "PA-MPJPE, W-MPJPE and WA-MPJPE fit the scale, so they don't show an error of it.",
                "The acceleration's error is the length of the vector over joints of the "
                "differences of |acceleration|, in the world, as acc_norm there.",
                "The figures of several people who are aligned jointly stand in the row of the "
                "first of them.",
            ),
            remainder="joined",
            joints=tuple(JOINT[name] for name in LSP_JOINTS),
            sample="segment",
        ),
        _protocol(
            "emdb",
            metrics=(
                "mpjpe_mm",
                "pa_mpjpe_mm",
                "mpjae_deg",
                "pa_mpjae_deg",
                "pve_mm",
                "pa_pve_mm",
                "jitter_10m_per_s3",
            ),
            source="eth-ait/emdb, evaluation_metrics.py and evaluation_engine.py",
            notes=(
                "PVE is called MVE there.",
                "The jitter of EMDB's own evaluation: nine joints count as standing still, which "
                "makes it 15/24 of the mean of the others; the pelvis' translation is left out; "
                "each sequence counts once. One file there calls the unit km/s^3, the other "
                "10 m/s^3, which it is.",
                "The figures of others on EMDB 2 are those of protocol wham.",
            ),
            once_per_clip=("jitter_10m_per_s3",),
            zeroed_joints=tuple(JOINT[name] for name in _EMDB_ZEROED),
            jitter="world_from_pelvis",
        ),
        _protocol(
            "vibe",
            metrics=(
                "mpjpe_mm",
                "pa_mpjpe_mm",
                "pve_mm",
                "accel_mm_per_frame2",
                "accel_error_mm_per_frame2",
            ),
            source="mkocabas/VIBE, lib/core/evaluate.py and lib/utils/eval_utils.py",
            notes=(
                _LSP_NOTE,
                "PVE is measured from the origin of SMPL's mesh, not from the hips.",
                "The acceleration is the prediction's own, its error that of the difference, both "
                "per frame and not per second.",
                "Released code also takes accelerations from one sequence to the next; --original "
                "gaps does so too.",
            ),
            joints=tuple(JOINT[name] for name in LSP_JOINTS),
            pve_from="origin",
        ),
    )
}

H36M_JOINTS = 17
H36M_ROWS = (6, 5, 4, 1, 2, 3, 16, 15, 14, 11, 12, 13, 8, 10)
"""Rows of Human3.6M's 17 joints in the order of `LSP_JOINTS`, as SLAHMR and VIBE take them."""
ON_3DPW: tuple[ProtocolName, ...] = ("wham", "gvhmr")
"""Protocols that measure 14 joints of Human3.6M in the camera's frame on 3DPW: WHAM's
lib/eval/evaluate_3dpw.py and GVHMR's hmr4d/model/gvhmr/callbacks/metric_3dpw.py."""


def protocol_as(name: ProtocolName, original: Sequence[Deviation | str] = ()) -> Protocol:
    """A protocol that follows the released code in what is named; in all that it has for "all".

    BadRecipe for a name that the protocol has no deviation of.
    """
    protocol, known = PROTOCOLS[name], ORIGINAL[name]
    wanted = list(known) if "all" in original else list(original)
    for one in wanted:
        if one not in known:
            has = ", ".join(known) or "none"
            raise BadRecipe(
                f"--original {one}: protocol {name} has no such deviation, it has {has}"
            )
    changes: dict[str, Any] = {}
    for one, change in known.items():
        changes |= change if one in wanted else {}
    switched = tuple(one for one in known if one in wanted)
    rest = tuple(one for one in known if one not in wanted)
    return protocol.model_copy(update=changes | {"original": switched, "deviations": rest})


def with_mesh_joints(protocol: Protocol, n_rows: int) -> Protocol:
    """A protocol whose joints are regressed from the mesh, by a matrix with a row for each joint.

    With SMPL's 24, they take the place of the skeleton's.  With Human3.6M's 17 or 14 of them, a
    protocol measures in the camera's frame alone what it has there, as WHAM and GVHMR do on 3DPW;
    those of 14 joints measure all that they have.
    """
    of_14 = n_rows in (H36M_JOINTS, len(LSP_JOINTS))
    needs_14 = len(protocol.joints) == len(LSP_JOINTS)
    if n_rows == N_JOINTS and not needs_14:
        return protocol.model_copy(update={"joints_from": "mesh"})
    if not of_14 or not (needs_14 or protocol.name in ON_3DPW):
        wanted = "17 or 14" if needs_14 else "24, 17 or 14" if protocol.name in ON_3DPW else "24"
        raise BadBodyFile(
            f"--joint-regressor: has {n_rows} rows, but protocol {protocol.name} takes {wanted}"
        )
    in_camera = tuple(one for one in protocol.metrics if one in _CAMERA)
    changes = {
        "metrics": protocol.metrics if needs_14 else in_camera,
        "joints": tuple(range(len(LSP_JOINTS))),
        "hips": (LSP_JOINTS.index("left_hip"), LSP_JOINTS.index("right_hip")),
        "joints_from": "mesh",
    }
    return protocol.model_copy(update=changes)
