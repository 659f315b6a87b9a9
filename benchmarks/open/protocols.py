"""Our protocols beside the released functions of their authors, on the same made-up people.

The functions are taken from clones that everyone fetches for themselves: nothing of them is kept.
Of a file only the named functions are run, and what their evaluation scripts do around them (cut
into segments, drop frames, take means) is done again here as the scripts do it.  All in double
precision, where released code takes single.
"""

import ast
import itertools
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gmrdata.values.body import JOINT, PARENTS, BodyModel
from gmrdata.values.clip import Clip
from gmrdata.values.skinning import global_rotmats, motion_joints_m, motion_vertices_m
from gmrdata.values.transforms import apply, invert
from tests.score.made_people import made_people, made_regressor, our_figures

FILES = {
    "wham": {"yohanshin+WHAM": ["lib/eval/eval_utils.py"]},
    "tram": {
        "yufu-wang+tram": [
            "lib/utils/eval_utils.py",
            "lib/vis/traj.py",
            "lib/camera/slam_utils.py",
        ]
    },
    "gvhmr": {"zju3dv+GVHMR": ["hmr4d/utils/eval/eval_utils.py"]},
    "slahmr": {"vye16+slahmr": ["slahmr/geometry/pcl.py", "slahmr/eval/tools.py"]},
    "emdb": {"eth-ait+emdb": ["evaluation_metrics.py"]},
    "vibe": {"mkocabas+VIBE": ["lib/utils/eval_utils.py"]},
}
"""Which files of which repository hold the functions of each."""
SKIPPED = {"load_body_model", "load_results_all", "run_smpl", "run_smpl_batch", "get_data"}
SMPL_VERTICES, FEET = 6890, (3216, 3387, 6617, 6787)
LSP = [JOINT[name] for name in (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)]  # fmt: skip


def released(folder: Path, name: str) -> SimpleNamespace:
    """The functions of a protocol's authors, and what they need of other packages."""
    import cv2
    from evo import main_ape
    from evo.core import sync
    from evo.core.metrics import PoseRelation
    from evo.core.trajectory import PoseTrajectory3D
    from scipy.ndimage import gaussian_filter

    space: dict[str, Any] = {
        "np": np, "torch": torch, "cv2": cv2, "sync": sync,
        # evo's newer versions don't know the name of the estimate, which is for its plots.
        "main_ape": SimpleNamespace(ape=lambda *a, est_name="", **k: main_ape.ape(*a, **k)),
        "PoseRelation": PoseRelation, "PoseTrajectory3D": PoseTrajectory3D,
        "gaussian_filter": gaussian_filter,
    }  # fmt: skip
    for repository, paths in FILES[name].items():
        for path in paths:
            tree = ast.parse(_text(folder / repository, path))
            kept = [node for node in tree.body if _is_pure(node)]
            exec(compile(ast.Module(kept, []), path, "exec"), space)
    return SimpleNamespace(**space)


def _is_pure(node: ast.stmt) -> bool:
    if isinstance(node, ast.Assign):
        return any(isinstance(one, ast.Name) and one.id == "SMPL_OR_JOINTS" for one in node.targets)
    return isinstance(node, ast.FunctionDef) and node.name not in SKIPPED


def _text(clone: Path, path: str) -> str:
    """A file of a checkout, or of the newest commit of a bare clone."""
    if (clone / path).is_file():
        return (clone / path).read_text()
    git_dir = clone / "repo" if (clone / "repo" / "HEAD").is_file() else clone
    command = ["git", f"--git-dir={git_dir}", "show", f"HEAD:{path}"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@dataclass
class Arrays:
    """One person as evaluation scripts have them before they drop frames: world and camera."""

    valid: np.ndarray
    joints: np.ndarray  # (T, 24, 3) in the world
    roots: np.ndarray  # (T, 3, 3)
    feet: np.ndarray  # (T, 4, 3)
    seen_joints: np.ndarray  # (T, 24, 3) in the camera's frame
    seen_vertices: np.ndarray  # (T, V, 3)
    seen_rotmats: np.ndarray  # (T, 24, 3, 3)
    camera: np.ndarray  # (T, 4, 4) world_from_cam
    rest_pelvis: np.ndarray  # (3,)


def arrays_of(clip: Clip, body: BodyModel, feet: Sequence[int]) -> Arrays:
    assert clip.camera is not None
    motion, cam_from_world = clip.motion, invert(clip.camera.world_from_cam)
    seen = replace(
        motion,
        root_rotmats=cam_from_world[:, :3, :3] @ motion.root_rotmats,
        pelvis_m=np.zeros_like(motion.pelvis_m),
    )
    places = apply(cam_from_world, motion.pelvis_m[:, None])
    return Arrays(
        clip.valid,
        motion_joints_m(body, motion),
        motion.root_rotmats,
        motion_vertices_m(body, motion)[:, list(feet)].astype(float),
        motion_joints_m(body, seen) + places,
        motion_vertices_m(body, seen).astype(float) + places,
        global_rotmats(PARENTS, seen.rotmats),
        clip.camera.world_from_cam,
        body.rest_pelvis_m(motion.shape),
    )


Pairs = Sequence[tuple[Arrays, Arrays]]  # the truth and the prediction of each person
Figures = dict[str, float]


def _t(array: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float64)


def _pooled(samples: Sequence[Mapping[str, np.ndarray]]) -> Figures:
    return {key: float(np.concatenate([one[key] for one in samples]).mean()) for key in samples[0]}


def _with_feet(feet: np.ndarray) -> torch.Tensor:
    """SMPL's vertices, of which only those of the feet are looked at."""
    vertices = torch.zeros(len(feet), SMPL_VERTICES, 3)
    vertices[:, list(FEET)] = _t(feet)
    return vertices


def _camera_figures(
    code: SimpleNamespace, true: Arrays, own: Arrays, hips: Sequence[int] = (1, 2)
) -> dict[str, np.ndarray]:
    """As WHAM's and TRAM's scripts take them, with accelerations per s^2 at 30 Hz."""
    good = true.valid
    given = [own.seen_joints, true.seen_joints, own.seen_vertices, true.seen_vertices]
    data = code.batch_align_by_pelvis([_t(one[good]) for one in given], list(hips))
    aligned = code.batch_compute_similarity_transform_torch(data[0], data[1])
    accel = code.compute_error_accel(joints_pred=data[0], joints_gt=data[1])[1:-1]
    return {
        "pa_mpjpe_mm": 1e3 * code.compute_jpe(aligned, data[1]),
        "mpjpe_mm": 1e3 * code.compute_jpe(data[0], data[1]),
        "pve_mm": 1e3 * code.compute_jpe(data[2], data[3]),
        "accel_error_m_per_s2": np.asarray(accel) * 30**2,
    }


def _segments(
    code: SimpleNamespace, true: torch.Tensor, own: torch.Tensor, rows: Sequence[tuple[int, int]]
) -> dict[str, np.ndarray]:
    found: dict[str, list[np.ndarray]] = {"w_mpjpe_mm": [], "wa_mpjpe_mm": []}
    for start, end in rows:
        true_part, part = true[start:end].clone(), own[start:end].clone()
        for key, align in zip(
            found, (code.first_align_joints, code.global_align_joints), strict=True
        ):
            found[key].append(code.compute_jpe(true_part, align(true_part, part)))
    return {key: 1e3 * np.concatenate(parts) for key, parts in found.items()}


def wham(code: SimpleNamespace, pairs: Pairs) -> Figures:
    samples = []
    for true, own in pairs:
        good = true.valid
        n, joints = int(good.sum()), _t(own.joints[good])
        chunks = [(start, min(n, start + 100)) for start in range(0, n, 100)]
        output = SimpleNamespace(joints=joints, vertices=_with_feet(own.feet[good]))
        target = SimpleNamespace(vertices=_with_feet(true.feet))
        samples.append(
            {
                **_camera_figures(code, true, own),
                **_segments(code, _t(true.joints[good]), joints, chunks),
                "rte_percent": code.compute_rte(_t(true.joints[good][:, 0]), joints[:, 0]) * 1e2,
                "jitter_10m_per_s3": code.compute_jitter(output, fps=30),
                "foot_sliding_mm": 1e3 * code.compute_foot_sliding(target, output, good),
            }
        )
    return _pooled(samples)


def gvhmr(code: SimpleNamespace, pairs: Pairs) -> Figures:
    names = {
        "wa2_mpjpe": "w_mpjpe_mm", "waa_mpjpe": "wa_mpjpe_mm", "rte": "rte_percent",
        "jitter": "jitter_10m_per_s3", "fs": "foot_sliding_mm", "pa_mpjpe": "pa_mpjpe_mm",
        "mpjpe": "mpjpe_mm", "pve": "pve_mm", "accel": "accel_error_m_per_s2",
    }  # fmt: skip
    samples = []
    for true, own in pairs:
        mask = torch.as_tensor(true.valid)
        seen = {
            "pred_j3d": _t(own.seen_joints), "target_j3d": _t(true.seen_joints),
            "pred_verts": _t(own.seen_vertices), "target_verts": _t(true.seen_vertices),
        }  # fmt: skip
        world = {
            "pred_j3d_glob": _t(own.joints), "target_j3d_glob": _t(true.joints),
            "pred_verts_glob": _with_feet(own.feet), "target_verts_glob": _with_feet(true.feet),
        }  # fmt: skip
        found = code.compute_camcoord_metrics(seen, mask=mask)
        found |= code.compute_global_metrics(world, mask=mask)
        samples.append({names[key]: np.asarray(value) for key, value in found.items()})
    return _pooled(samples)


def tram(code: SimpleNamespace, pairs: Pairs) -> Figures:
    samples, cameras = [], []
    for true, own in pairs:
        good = true.valid
        n, target = int(good.sum()), _t(true.joints[good])
        joints = code.traj_filter(_t(own.joints), _t(own.joints))[1][good]
        chunks = []
        for start in range(0, n - 100, 100):
            chunks.append((start, n - 1 if start + 200 > n else start + 100))
        roots = _t(true.roots[good]), _t(own.roots[good])
        samples.append(
            {
                **_camera_figures(code, true, own),
                **_segments(code, target, joints, chunks),
                "rte_percent": code.compute_rte(target[:, 0], joints[:, 0]) * 1e2,
                "erve_mm_per_frame": 1e3
                * np.asarray(code.computer_erve(roots[0], target, roots[1], joints)),
            }
        )
        quats = [Rotation.from_matrix(one.camera[:, :3, :3]).as_quat() for one in (true, own)]
        true_quats, own_quats = (one[:, [3, 0, 1, 2]] for one in quats)
        path = np.concatenate([own.camera[:, :3, 3], own_quats], axis=1)
        given = (true.camera[:, :3, 3], true_quats)
        cameras.append(
            [
                code.eval_slam(path.copy(), *given, correct_scale=scale)[0]["mean"]
                for scale in (True, False)
            ]
        )
    ate, ate_s = np.mean(cameras, axis=0)
    return {**_pooled(samples), "ate_m": float(ate), "ate_s_m": float(ate_s)}


def slahmr(code: SimpleNamespace, pairs: Pairs, joints: Sequence[int] = LSP) -> Figures:
    """Jobs of the video's frames; all tracks of a job go through `eval_result_dir` at once."""
    n = len(pairs[0][0].valid)
    splits = list(range(0, n, 100))
    splits[-1] = n
    found: dict[str, list[float]] = {}
    for start, end in itertools.pairwise(splits):
        valid = torch.stack([torch.as_tensor(true.valid[start:end]) for true, _ in pairs])
        target, own = (
            torch.stack([_t(pair[which].joints[start:end, list(joints)]) for pair in pairs])[valid]
            for which in (0, 1)
        )
        made = {
            "pa_mpjpe_mm": (target, code.local_align_joints(target, own)),
            "wa_mpjpe_mm": (target, code.global_align_joints(target, own)),
            "w_mpjpe_mm": (target, code.first_align_joints(target, own)),
            "accel_length_error_mm_per_frame2": (
                code.compute_accel_norm(target),
                code.compute_accel_norm(own),
            ),
        }
        for key, (truth, prediction) in made.items():
            error = torch.linalg.norm(truth - prediction, dim=-1).mean()
            found.setdefault(key, []).append(1e3 * float(error))
    return {key: float(np.mean(values)) for key, values in found.items()}


def emdb(code: SimpleNamespace, pairs: Pairs) -> Figures:
    samples, jitters = [], []
    for true, own in pairs:
        good = true.valid
        # SMPL's translation of the prediction is 0, so that its pelvis is where the mesh has it.
        shift = own.rest_pelvis - own.seen_joints[:, :1]
        given = (
            (own.seen_joints + shift)[good].copy(),
            true.seen_joints[good].copy(),
            own.seen_rotmats[good][:, code.SMPL_OR_JOINTS],
            true.seen_rotmats[good],
            (own.seen_vertices + shift)[good],
            true.seen_vertices[good],
        )
        code.compute_metrics.__globals__["get_data"] = lambda *_, given=given: given
        figures, extra = code.compute_metrics(*[None] * 8)
        samples.append(
            {
                "mpjpe_mm": extra["mpjpe_all"],
                "pa_mpjpe_mm": extra["mpjpe_pa_all"],
                "mpjae_deg": np.mean(extra["mpjae_all"], axis=-1),
                "pa_mpjae_deg": np.mean(extra["mpjae_pa_all"], axis=-1),
                "pve_mm": extra["mve_all"],
                "pa_pve_mm": extra["mve_pa_all"],
            }
        )
        jitters.append(figures["Jitter [km/s^3]"])
    return {**_pooled(samples), "jitter_10m_per_s3": float(np.mean(jitters))}


def vibe(code: SimpleNamespace, pairs: Pairs) -> Figures:
    """As `Evaluator.evaluate` does with all sequences in one array."""
    joints, vertices = [], []
    for which in (1, 0):
        both = [(pair[which], pair[0].valid) for pair in pairs]
        stacked = _t(np.vstack([one.seen_joints[good][:, LSP] for one, good in both]))
        joints.append(stacked - (stacked[:, [2]] + stacked[:, [3]]) / 2.0)
        at_origin = [
            one.seen_vertices - one.seen_joints[:, :1] + one.rest_pelvis for one, _ in both
        ]
        vertices.append(np.vstack([v[good] for v, (_, good) in zip(at_origin, both, strict=True)]))
    own, true = joints
    aligned = code.batch_compute_similarity_transform_torch(own, true)
    distance: Callable[[Any, Any], float] = lambda a, b: float(  # noqa: E731
        torch.sqrt(((a - b) ** 2).sum(dim=-1)).mean()
    )
    accel_error = code.compute_error_accel(joints_pred=own.numpy(), joints_gt=true.numpy())
    return {
        "mpjpe_mm": 1e3 * distance(own, true),
        "pa_mpjpe_mm": 1e3 * distance(aligned, true),
        "pve_mm": 1e3 * float(np.mean(code.compute_error_verts(*vertices))),
        "accel_mm_per_frame2": 1e3 * float(np.mean(code.compute_accel(own.numpy()))),
        "accel_error_mm_per_frame2": 1e3 * float(np.mean(accel_error)),
    }


def wham_on_3dpw(code: SimpleNamespace, pairs: Pairs) -> Figures:
    return _pooled([_camera_figures(code, true, own, (2, 3)) for true, own in pairs])


SCRIPTS = {"wham": wham, "tram": tram, "gvhmr": gvhmr, "slahmr": slahmr, "emdb": emdb, "vibe": vibe}
MESH_CASE = "2 people, with gaps, joints from the mesh"
CASES = [(people, gaps) for people in (1, 2) for gaps in (False, True)]


def case_name(people: int, gaps: bool) -> str:
    return f"{people} people, {'with' if gaps else 'without'} gaps"


def regressed(arrays: Arrays, matrix: np.ndarray) -> Arrays:
    """The same with joints that a regressor takes from the vertices."""
    seen = np.einsum("jv,tvd->tjd", matrix, arrays.seen_vertices)
    return replace(arrays, seen_joints=seen, joints=apply(arrays.camera, seen))


def mesh_figures(code: Mapping[str, SimpleNamespace], pairs: Pairs, body: BodyModel) -> dict[
    str, Figures
]:  # fmt: skip
    """What released functions make of joints from the mesh: Human3.6M's 14, SMPL's 24."""
    of_24 = [tuple(regressed(one, made_regressor(body, 24)) for one in pair) for pair in pairs]
    of_14 = [tuple(regressed(one, made_regressor(body, 14)) for one in pair) for pair in pairs]
    return {
        "gvhmr": gvhmr(code["gvhmr"], of_24),  # type: ignore[arg-type]
        "wham": wham_on_3dpw(code["wham"], of_14),  # type: ignore[arg-type]
        "slahmr": slahmr(code["slahmr"], of_14, range(14)),  # type: ignore[arg-type]
    }


def released_figures(
    folder: Path, body: BodyModel, feet: Sequence[int]
) -> dict[str, dict[str, Figures]]:
    """What released functions make of the people: case -> protocol -> metric -> figure."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        codes = {name: released(folder, name) for name in SCRIPTS}
        found: dict[str, dict[str, Figures]] = {}
        for people, gaps in CASES:
            made = made_people(body, people, gaps=gaps)
            pairs = [
                (arrays_of(true, body, feet), arrays_of(own, body, feet)) for true, own in made
            ]
            found[case_name(people, gaps)] = {
                name: script(codes[name], pairs) for name, script in SCRIPTS.items()
            }
        found[MESH_CASE] = mesh_figures(codes, pairs, body)
        return found
    finally:
        torch.set_default_dtype(before)


def _rows(case: str, name: str, theirs: Figures, ours: Mapping[Any, float]) -> list[dict[str, Any]]:
    return [
        {
            "case": case, "protocol": name, "metric": metric, "released": figure,
            "ours": ours[metric], "difference": abs(ours[metric] - figure) / abs(figure),
        }
        for metric, figure in theirs.items()
    ]  # fmt: skip


def compared(folder: Path, body: BodyModel, feet: Sequence[int], work_dir: Path) -> dict[str, Any]:
    """The largest difference of ours to released figures, relative, and each of them."""
    theirs = released_figures(folder, body, feet)
    rows: list[dict[str, Any]] = []
    for people, gaps in CASES:
        case = case_name(people, gaps)
        for name in SCRIPTS:
            made = made_people(body, people, gaps=gaps)
            ours = our_figures(name, body, made, work_dir)  # type: ignore[arg-type]
            rows += _rows(case, name, theirs[case][name], ours)
    for name, figures in theirs[MESH_CASE].items():
        matrix = made_regressor(body, 24 if name == "gvhmr" else 14)
        ours = our_figures(name, body, made, work_dir, regressor=matrix)  # type: ignore[arg-type]
        rows += _rows(MESH_CASE, name, figures, ours)
    return {
        "protocol_difference_max": max(row["difference"] for row in rows),
        "protocol_figures": len(rows),
        "protocols": rows,
    }
