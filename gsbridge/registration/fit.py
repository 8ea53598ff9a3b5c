"""The fit: finds the camera mount, the board's pose and, if asked, its size from all tag corners of all poses at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gsbridge.cameras import Camera
from gsbridge.geometry import Array
from gsbridge.registration.handeye import HandEye
from gsbridge.registration.sightings import Sighting

_LOSS_PX = 1.0
"""Scale of the robust loss, px: beyond this residual, a corner's influence on the fit hardly grows any more."""

_FAR_PX = 1e3
"""Residual given to a corner that a trial step puts behind the camera, px; also the largest residual that counts."""


@dataclass(frozen=True)
class RegistrationViews:
    """All sightings of the board, stored in flat arrays.

    Args:
        camera: Intrinsics.
        base_from_flange: Pose of the flange at each photo. [N, 4, 4].
        cam_from_board: Pose of the board found from each photo alone, with the board at its assumed size, m. [N, 4, 4].
        points: Tag corners in the board frame, with the board at its assumed size, m. [K, 3].
        pixels: Positions at which the corners were seen, px. [K, 2].
        pose: Index (0 to N - 1) of the pose that each corner belongs to. [K].
    """

    camera: Camera
    base_from_flange: Array
    cam_from_board: Array
    points: Array
    pixels: Array
    pose: Array

    @classmethod
    def of(cls, camera: Camera, base_from_flange: Array, sightings: Sequence[Sighting]) -> RegistrationViews:
        """Build the views from one sighting per pose.

        Args:
            camera: Camera of all photos.
            base_from_flange: Pose of the flange at each photo. [N, 4, 4].
            sightings: The board in each photo, in the order of `base_from_flange`.
        """
        return cls(
            camera,
            np.asarray(base_from_flange, dtype=np.float64),
            np.array([item.cam_from_board for item in sightings]),
            np.concatenate([item.points for item in sightings]),
            np.concatenate([item.pixels for item in sightings]),
            np.repeat(np.arange(len(sightings)), [len(item.points) for item in sightings]),
        )

    def __len__(self) -> int:
        return len(self.base_from_flange)

    def only(self, keep: Array) -> RegistrationViews:
        """Return the views of the poses for which `keep` (bool, [N]) is true."""
        rows = keep[self.pose]
        number = np.cumsum(keep) - 1
        return RegistrationViews(
            self.camera,
            self.base_from_flange[keep],
            self.cam_from_board[keep],
            self.points[rows],
            self.pixels[rows],
            number[self.pose[rows]],
        )


@dataclass(frozen=True)
class Fit:
    """Result of `fit_views`.

    Args:
        found: Camera mount, board pose and scale.
        covariance: Covariance of the parameters of `moved` (m, rad, and the logarithm of the scale if it is fitted), estimated
            from the scatter of the corners' residuals. [12 or 13, same].
        residuals: Reprojection errors, px. [K, 2].
    """

    found: HandEye
    covariance: Array
    residuals: Array

    @property
    def rms_px(self) -> float:
        """Root mean square distance between seen and predicted corners, px."""
        return float(np.sqrt((self.residuals**2).sum(1).mean()))


def moved(start: HandEye, step: Array) -> HandEye:
    """Change a hand-eye calibration by a small step.

    Args:
        start: Calibration to change.
        step: Shift, m, and turn, rad, of the mount in the flange frame; shift and turn of the board in the base frame; with 13
            values, also the change of the scale's logarithm. Each turn is about the moved frame's own origin. [12 or 13].
    """
    out = HandEye(
        start.flange_from_camera.copy(),
        start.base_from_board.copy(),
        start.scale * float(np.exp(step[12])) if len(step) > 12 else start.scale,
    )
    for pose, part in ((out.flange_from_camera, step[:6]), (out.base_from_board, step[6:12])):
        pose[:3, 3] += part[:3]
        pose[:3, :3] = Rotation.from_rotvec(part[3:]).as_matrix() @ pose[:3, :3]
    return out


def predict(views: RegistrationViews, found: HandEye) -> Array:
    """Predict the pixels at which the corners appear, px; NaN for corners behind the camera. [K, 2]."""
    cam_from_base = np.linalg.inv(views.base_from_flange @ found.flange_from_camera)
    base = found.scale * views.points @ found.base_from_board[:3, :3].T + found.base_from_board[:3, 3]
    local = np.einsum("kij,kj->ki", cam_from_base[views.pose, :3, :3], base) + cam_from_base[views.pose, :3, 3]
    return views.camera.project(local)


def fit_views(views: RegistrationViews, start: HandEye, *, with_scale: bool) -> Fit:
    """Minimise the reprojection error over all corners with a robust loss.

    Args:
        views: The sightings.
        start: Calibration from which the fit starts.
        with_scale: Whether the board's size is fitted, too.
    """

    def residual(step: Array) -> Array:
        error = predict(views, moved(start, step)) - views.pixels
        return np.nan_to_num(np.clip(error, -_FAR_PX, _FAR_PX), nan=_FAR_PX).ravel()

    size = 13 if with_scale else 12
    scales = np.array([1e-3, 1e-3, 1e-3, 3e-3, 3e-3, 3e-3] * 2 + [3e-3])[:size]
    result = least_squares(residual, np.zeros(size), loss="soft_l1", f_scale=_LOSS_PX, x_scale=scales)
    errors = residual(result.x).reshape(-1, 2)
    # The median absolute residual estimates sigma robustly: half of a normal distribution lies within 0.6745 sigma.
    sigma = max(float(np.median(np.abs(errors))) / 0.6745, 1e-6)
    slope = np.asarray(result.jac)
    covariance = sigma**2 * np.linalg.pinv(slope.T @ slope)
    return Fit(moved(start, result.x), covariance, errors)


def pose_rms(views: RegistrationViews, fit: Fit) -> Array:
    """Return the root mean square reprojection error of each pose, px. [N]."""
    squares = np.bincount(views.pose, (fit.residuals**2).sum(1), len(views))
    return np.sqrt(squares / np.bincount(views.pose, minlength=len(views)))


def consistent(views: RegistrationViews, start: HandEye, *, with_scale: bool, floor_px: float, least: int) -> tuple[Fit, Array]:
    """Fit, and leave out poses that contradict the others.

    A pose contradicts the others if, for example, its photo is listed with another arm pose, or the arm was still moving.

    Args:
        views: All poses.
        start: Calibration from which the fit starts.
        with_scale: Whether the board's size is fitted, too.
        floor_px: Reprojection error, px, up to which no pose is left out.
        least: Number of poses at which no further pose is left out.

    Returns:
        The fit to the poses that are kept, and a mask that is true for these poses, bool [N].
    """
    keep = np.ones(len(views), dtype=bool)
    while True:
        part = views.only(keep)
        fit = fit_views(part, start, with_scale=with_scale)
        errors = pose_rms(part, fit)
        worst = int(np.argmax(errors))
        # Leave out one pose at a time: a wrong pose distorts the fit and so raises the errors of the right poses, too.
        if errors[worst] <= max(floor_px, 4.0 * float(np.median(errors))) or keep.sum() <= least:
            return fit, keep
        keep[np.flatnonzero(keep)[worst]] = False


@dataclass(frozen=True)
class LeftOut:
    """Result of leaving out one pose at a time.

    Args:
        residuals_m: Distance between the board's centre as the left-out pose sees it and as the other poses place it, m. [N].
        covariance: Jackknife covariance of the parameters. Unlike `Fit.covariance`, it includes errors that all corners of one
            pose share, mainly errors of the arm. [12 or 13, same].
    """

    residuals_m: Array
    covariance: Array


def leave_one_out(views: RegistrationViews, fit: Fit, *, with_scale: bool) -> LeftOut:
    """Fit again without each pose in turn.

    Args:
        views: All sightings.
        fit: Fit to all of them.
        with_scale: Whether the board's size is fitted, too.

    Returns:
        The residual of each left-out pose, m, and the jackknife covariance.

    Source: Efron and Stein, Annals of Statistics 9(3), 1981, for the jackknife.
    """
    count = len(views)
    residuals, steps = np.empty(count), []
    for index in range(count):
        without = fit_views(views.only(np.arange(count) != index), fit.found, with_scale=with_scale).found
        seen = without.board_poses(views.base_from_flange[[index]], views.cam_from_board[[index]])[0]
        residuals[index] = np.linalg.norm(seen[:3, 3] - without.base_from_board[:3, 3])
        steps.append(_difference(fit.found, without, with_scale))
    spread = np.array(steps) - np.mean(steps, axis=0)
    return LeftOut(residuals, (count - 1) / count * spread.T @ spread)


def _difference(start: HandEye, other: HandEye, with_scale: bool) -> Array:
    """Return the step with which `moved` turns `start` into `other`. [12 or 13]."""
    parts = []
    for a, b in ((start.flange_from_camera, other.flange_from_camera), (start.base_from_board, other.base_from_board)):
        parts += [b[:3, 3] - a[:3, 3], Rotation.from_matrix(b[:3, :3] @ a[:3, :3].T).as_rotvec()]
    return np.concatenate([*parts, [np.log(other.scale / start.scale)]] if with_scale else parts)
