"""The fit: a body laid onto a track's landmarks, all frames at once.

Least squares with few outliers (Geman and McClure 1987): landmarks in the picture, the network's
metres from the hips, second differences over time, and how far joints may turn.  It needs no
learned prior, so it is the fallback and the oracle of the lifter; with the lifter's poses to start
from, it stays near them and mends where they lie in the picture.
"""

from dataclasses import dataclass

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from gmrdata.people.landmark_network import (
    LANDMARKS,
    LEG_M,
    from_hips,
    landmark_offsets_m,
    landmarks_on,
    tree_joints,
)
from gmrdata.people.lifter import LiftedPose, SeenLandmarks, landmark_weights, views_of
from gmrdata.values.body import JOINT, JOINT_NAMES, N_JOINTS, PARENTS, leg_length_m
from gmrdata.values.records import Config


class FitConfig(Config):
    """What each term of the fit is weighed by: its usual size."""

    steps: int = Field(default=120, ge=1)
    steps_from_start: int = Field(default=60, ge=1)
    """Steps where there are poses to start from, which are nearly right."""
    image: float = Field(default=0.08, gt=0)
    """Landmarks in the picture, in the person's size."""
    world_m: float = Field(default=0.10, gt=0)
    """The network's metres [m]."""
    acceleration: float = Field(default=12.0, gt=0)
    """Of landmarks about the hips [m/s2]."""
    pelvis_acceleration: float = Field(default=8.0, gt=0)
    """Of the pelvis before the camera [m/s2]."""
    rest: float = Field(default=1.0, gt=0)
    """How far joints turn from their rest pose; larger lets them turn more."""
    start: float = Field(default=0.5, gt=0)
    """How far joints turn from the poses to start from, where there are any."""
    leg: float = Field(default=0.07, gt=0)
    """Logarithm of the legs' length."""


@dataclass(frozen=True, eq=False)
class FittedPose:
    """The body at each of the T frames."""

    rotmats: np.ndarray  # (T, 24, 3, 3), the root's in the camera's axes
    pelvis_m: np.ndarray  # (T, 3) before the camera
    leg_m: float


_REST_WEIGHTS = {
    "spine1": 1.5, "spine2": 1.5, "spine3": 1.5, "neck": 1.0, "head": 1.0,
    "left_collar": 3.0, "right_collar": 3.0, "left_wrist": 0.5, "right_wrist": 0.5,
    "left_ankle": 0.5, "right_ankle": 0.5, "left_foot": 3.0, "right_foot": 3.0,
    "left_hand": 3.0, "right_hand": 3.0, "pelvis": 0.0,
}  # fmt: skip
"""How much a joint is drawn to its rest pose; hips, knees, shoulders and elbows little."""
_WEIGHTS = tuple(_REST_WEIGHTS.get(name, 0.04) for name in JOINT_NAMES)


def fit(
    seen: SeenLandmarks,
    rest_joints_m: np.ndarray,
    config: FitConfig,
    start: LiftedPose | None = None,
) -> FittedPose:
    """Lay a body whose rest joints (24, 3) grow with its legs onto a track of two frames or more.

    Metres are compared along each frame's ray.
    """
    problem = _Problem(seen, rest_joints_m, config, start)
    steps = config.steps if start is None else config.steps_from_start
    optimiser = torch.optim.LBFGS(
        problem.unknowns, max_iter=steps, history_size=20, line_search_fn="strong_wolfe"
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        energy = problem.energy()
        energy.backward()
        return energy

    optimiser.step(closure)
    with torch.no_grad():
        rotmats = problem.rotmats().double().numpy()
        pelvis_m = problem.pelvis_m().double().numpy()
    return FittedPose(rotmats, pelvis_m, float(LEG_M * torch.exp(problem.log_leg.detach())))


_BONES = {
    JOINT[f"{side}_{joint}"]: (
        LANDMARKS.index(f"{side}_{joint}"),
        LANDMARKS.index(f"{side}_{child}"),
        JOINT[f"{side}_{child}"],
    )
    for side in ("left", "right")
    for joint, child in (
        ("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"),
    )
}  # fmt: skip
"""By joint: landmarks between which its bone lies, and the joint at its end."""


def _turn_between(start: Tensor, ends: Tensor) -> Tensor:
    """The smallest turns (T, 3, 3) from a direction (3,) to others (T, 3)."""
    a = torch.nn.functional.normalize(start, dim=-1).expand_as(ends)
    b = torch.nn.functional.normalize(ends, dim=-1)
    half = torch.nn.functional.normalize(a + b + 1e-4 * b.roll(1, -1), dim=-1)
    # Two reflections: at a's own plane, then at the one half way.
    reflected = torch.eye(3) - 2 * a[..., None] * a[..., None, :]
    return (torch.eye(3) - 2 * half[..., None] * half[..., None, :]) @ reflected


class _Problem:
    """The unknowns and their energy."""

    def __init__(
        self,
        seen: SeenLandmarks,
        rest_joints_m: np.ndarray,
        config: FitConfig,
        start: LiftedPose | None,
    ) -> None:
        def tensor(array: np.ndarray) -> Tensor:
            return torch.as_tensor(array, dtype=torch.float32)

        self.config = config
        self.rays, self.world_m = tensor(seen.rays), tensor(seen.world_m)
        self.view = views_of(self.rays)
        self.weights = landmark_weights(tensor(seen.visibility))
        self.steps_s = tensor(np.diff(seen.times_s))
        self.rest_m = tensor(rest_joints_m * (LEG_M / leg_length_m(rest_joints_m)))
        self.offsets_m = tensor(landmark_offsets_m())
        self.start = None if start is None else tensor(start.rotmats)
        leg_m = LEG_M if start is None else float(np.median(start.leg_m))
        first = self._first_rotmats() if self.start is None else self.start
        self.columns = first[..., :2].clone().requires_grad_()
        self.log_leg = torch.tensor(float(np.log(leg_m / LEG_M)), requires_grad=True)
        self.log_depth = torch.log(0.5 / self.view.sizes).requires_grad_()
        self.aside = self.rays[:, [23, 24]].mean(1).clone().requires_grad_()
        self.unknowns = [self.columns, self.log_leg, self.log_depth, self.aside]

    def _first_rotmats(self) -> Tensor:
        """Trunk and limbs as the network's metres have them, without a twist."""
        world_m = self.world_m @ self.view.cam_from_ray.transpose(-1, -2)
        left = world_m[:, [11, 23]].sum(1) - world_m[:, [12, 24]].sum(1)
        up = world_m[:, [11, 12]].sum(1) - world_m[:, [23, 24]].sum(1)
        x = torch.nn.functional.normalize(left, dim=-1)
        z = torch.nn.functional.normalize(torch.cross(x, up, dim=-1), dim=-1)
        root = torch.stack([x, torch.cross(z, x, dim=-1), z], dim=-1)
        local = [torch.eye(3).expand(len(x), 3, 3)] * N_JOINTS
        local[0], turned = root, [root]
        for joint in range(1, N_JOINTS):
            before = turned[PARENTS[joint]]
            if joint in _BONES:
                start, end, child = _BONES[joint]
                wanted = (world_m[:, end] - world_m[:, start])[:, None] @ before
                local[joint] = _turn_between(self.rest_m[child] - self.rest_m[joint], wanted[:, 0])
            turned.append(before @ local[joint])
        return torch.stack(local, dim=1)

    def rotmats(self) -> Tensor:
        import roma

        return roma.special_gramschmidt(self.columns, epsilon=1e-6)

    def pelvis_m(self) -> Tensor:
        depth_m = torch.exp(self.log_depth)[:, None]
        return torch.cat([self.aside * depth_m, depth_m], dim=-1)

    def energy(self) -> Tensor:
        config, rotmats = self.config, self.rotmats()
        pelvis_m, leg = self.pelvis_m(), torch.exp(self.log_leg)
        joints_m, turned = tree_joints(self.rest_m * leg, rotmats)
        legs_m = (LEG_M * leg).expand(len(rotmats))
        about_m = landmarks_on(joints_m, turned, legs_m, self.offsets_m)
        placed_m = about_m + pelvis_m[:, None]
        rays = placed_m[..., :2] / placed_m[..., 2:].clamp(min=0.1)
        image = (rays - self.rays) / self.view.sizes[:, None, None] / config.image
        # The network's metres are of one size for all people.
        hips_m = from_hips(about_m / leg) @ self.view.cam_from_ray
        world = (hips_m - self.world_m) / config.world_m
        terms = (self.weights * (_robust(image) + _robust(world))).sum() / SAME_TIME
        terms = terms + self._over_time(from_hips(about_m), pelvis_m)
        return terms + self._turns(rotmats) + len(rotmats) * (self.log_leg / config.leg) ** 2

    def _over_time(self, about_m: Tensor, pelvis_m: Tensor) -> Tensor:
        """Second differences of landmarks and of the pelvis."""
        if len(self.steps_s) < 2:
            return torch.zeros(())
        config = self.config
        about = _accelerations(about_m.flatten(1), self.steps_s) / config.acceleration
        pelvis = _accelerations(pelvis_m, self.steps_s) / config.pelvis_acceleration
        return about.pow(2).sum() / 33 + pelvis.pow(2).sum()

    def _turns(self, rotmats: Tensor) -> Tensor:
        config = self.config
        knees = rotmats[:, [JOINT["left_knee"], JOINT["right_knee"]]]
        elbows = rotmats[:, [JOINT["left_elbow"], JOINT["right_elbow"]]]
        # A knee turns about x and only backward, an elbow only forward.
        forward = elbows[..., 2, 0] * torch.tensor([1.0, -1.0])
        hinges = (1 - knees[..., 0, 0]).sum() * 4 + torch.relu(-knees[..., 2, 1]).pow(2).sum() * 40
        hinges = hinges + torch.relu(-forward).pow(2).sum() * 40
        if self.start is not None:
            off = (rotmats - self.start).pow(2).sum((-1, -2))
            return hinges + off.sum() / config.start**2 / N_JOINTS
        off = (rotmats - torch.eye(3)).pow(2).sum((-1, -2))
        return hinges + (off * torch.tensor(_WEIGHTS)).sum() / config.rest**2


SAME_TIME = 4.0  # landmarks of a frame err together: so many of them tell as much as one


def _robust(residuals: Tensor) -> Tensor:
    """Geman and McClure's (..., 33) of residuals (..., 33, n): their square, at most 9."""
    squared = residuals.pow(2).sum(-1)
    return 9 * squared / (9 + squared)


def _accelerations(values: Tensor, steps_s: Tensor) -> Tensor:
    """Second differences (T - 2, n) per second squared of values (T, n)."""
    speeds = (values[1:] - values[:-1]) / steps_s[:, None]
    between_s = (steps_s[1:] + steps_s[:-1]) / 2
    return (speeds[1:] - speeds[:-1]) / between_s[:, None]
