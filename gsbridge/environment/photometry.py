"""Calibration of the wrist camera's response to colours that a phone filmed, and of the robot's colours.

Phone and wrist camera differ in exposure, white balance and tone curve, and the lamp may have moved between film and work. The
registration's photos of the board show the same table as the film. So the table's splats are drawn from where each photo was
taken, and the response is fitted that turns the drawn colours into the photo's. The closed hand at the lower edge of each photo
shows the hand's own colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares

from gsbridge.asset.bundle import Asset, read_asset
from gsbridge.cameras import Camera
from gsbridge.environment.robot_splats import link_meshes
from gsbridge.errors import InputError
from gsbridge.files import read_json, write_stage
from gsbridge.geometry import Array
from gsbridge.images import linear_from_srgb, read_image, srgb_from_linear
from gsbridge.meshes import Mesh
from gsbridge.registration.capture import BoardCapture, read_board_capture
from gsbridge.registration.result import Registration, read_registration
from gsbridge.robot.assembly import RobotFiles
from gsbridge.robot.kinematics import Kinematics
from gsbridge.robot.links import Colour
from gsbridge.scene.editing import Composition
from gsbridge.scene.meshes import MeshComposition, uniform
from gsbridge.scene.underlay import with_underlay
from gsbridge.scene.view import shoot
from gsbridge.sim.camera import CameraResponse

WIDTH = 160
"""Photos are shrunk to this many pixels: finer detail than the splats hold would only add scatter."""

OPAQUE = 0.99
HAND_BORDER = 2
"""Width of the border round the robot that counts as neither robot nor table, px; poses are a fraction of a pixel off."""

FEWEST_PIXELS = 500
FEWEST_OF_LINK = 60
"""Smallest number of pixels, over all photos, from which the colour of a link is measured."""

SOFT = 0.03
"""Residual, encoded, beyond which a pixel counts less: shadows of arm and hand, glints, detail that the splats lack."""


_BOUNDS = MappingProxyType(
    {"gain": (0.1, 10.0), "red_gain": (0.3, 3.0), "blue_gain": (0.3, 3.0), "gamma": (0.5, 2.0), "black_level": (-0.2, 0.2)}
)
"""Smallest and largest value of each parameter of a response; beyond them no camera of the kind is known."""

_AT_BOUND = 0.01
"""A parameter this close to a bound, as a share of the way between both, was stopped by it; factors by their logarithms."""

_MOST_RMS = 0.1
"""Largest difference of splats and photos, encoded, that a good fit leaves: the mirror's photos leave 0.03, a table of small
squares in strong colours 0.06, and the same table 0.12 if its splats lie 10 mm beside, and 0.2 if they are another table's."""


def fit_response(drawn: Array, seen: Array) -> CameraResponse:
    """The response that turns drawn colours into seen ones.

    Args:
        drawn, seen: Encoded colours of the same places, 0..1. [N, 3] each.

    Raises:
        InputError: There are too few places.
    """
    if len(drawn) < FEWEST_PIXELS:
        raise InputError("wrist camera", f"only {len(drawn)} pixels show the table", "Take photos that show more of it")

    def of(values: Array) -> CameraResponse:
        gain, red, blue = np.exp(values[:3])
        return CameraResponse(float(gain), float(red), float(blue), float(np.exp(values[3])), float(values[4]))

    def residuals(values: Array) -> Array:
        return (of(values).apply(drawn) - seen).ravel()

    low, high = (np.array([_scaled(name, ends[k]) for name, ends in _BOUNDS.items()]) for k in range(2))
    return of(least_squares(residuals, np.zeros(5), bounds=(low, high), loss="soft_l1", f_scale=SOFT).x)


def _scaled(name: str, value: float) -> float:
    """Return a parameter as it is fitted: factors and exponents by their logarithms."""
    return value if name == "black_level" else float(np.log(value))


def doubts_about(response: CameraResponse, rms: float) -> list[str]:
    """Return the reasons to doubt a fitted response, none if it is good.

    Args:
        response: The response.
        rms: Root mean square of the difference that it leaves between splats and photos, encoded, 0..1.
    """
    reasons = []
    stopped = []
    for name, ends in _BOUNDS.items():
        low, at, high = (_scaled(name, value) for value in (ends[0], getattr(response, name), ends[1]))
        if min(at - low, high - at) < _AT_BOUND * (high - low):
            stopped.append(f"{name} {getattr(response, name):.3g}")
    if stopped:
        which = " and ".join(stopped)
        reasons.append(
            f"the wrist camera's response is at the limit of what cameras do ({which}): was it this table and light?"
        )
    if rms > _MOST_RMS:
        reasons.append(
            f"even with the wrist camera's response, the table in its photos is {rms:.2f} of full scale off its splats: "
            "was it this table, with the board where it was filmed, and does the registration fit?"
        )
    return reasons


@dataclass(frozen=True)
class Photometry:
    """Colours of the wrist camera and the robot as they were measured.

    Args:
        response: Response of the wrist camera.
        robot_colours: sRGB of links as splats carry it, before the response; links that no photo shows are missing.
    """

    response: CameraResponse
    robot_colours: Mapping[str, Colour]


def read_photometry(path: str | Path) -> Photometry:
    """Read what `calibrate_wrist_camera` wrote.

    Raises:
        InputError: The file is missing or damaged.
    """
    content = read_json(path)
    try:
        colours = {name: (float(r), float(g), float(b)) for name, (r, g, b) in content["robot_colours"].items()}
        return Photometry(CameraResponse(**{key: float(value) for key, value in content["response"].items()}), colours)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(path, f"the photometry is damaged ({error!r})", "Delete it and calibrate again") from error


def calibrate_wrist_camera(
    record: str | Path,
    *,
    registration: str | Path,
    robot: str | Path,
    capture: str | Path | None = None,
    background: str | Path | None = None,
) -> None:
    """Measure the wrist camera's response and the colours of the hand.

    Args:
        record: Record of the stage, `read_photometry` reads it.
        registration: `registration.json`.
        robot: Folder of the robot's description.
        capture: Folder of the board capture; None where the workspace was typed.
        background: `asset.json` of the table as it was when the board was photographed; None if no scene shows that table.
            Without capture or background the response is neutral, the colours are the description's, and the result degraded.

    Raises:
        InputError: A file is missing or damaged, or the photos show too little of the table.
    """
    if capture is None or background is None:
        what = "no photos of the board" if capture is None else "no scene of the table that the board lay on"
        _write(record, Photometry(CameraResponse(), {}), [f"there are {what}: the wrist camera's colours are not calibrated"])
        return
    photos = read_board_capture(capture)
    samples = _Samples.of(photos, read_registration(registration), RobotFiles.read(robot), read_asset(background))
    response = fit_response(samples.drawn, samples.seen)
    colours: dict[str, Colour] = {}
    for name, values in samples.links.items():
        if len(values) >= FEWEST_OF_LINK:
            red, green, blue = (float(value) for value in response.undo(np.median(values, axis=0)))
            colours[name] = (red, green, blue)
    before, after = (
        float(np.sqrt(np.mean((picture - samples.seen) ** 2))) for picture in (samples.drawn, response.apply(samples.drawn))
    )
    reasons = doubts_about(response, after)
    if not colours:
        reasons.append("no photo shows the hand: its colours are the description's")
    _write(
        record,
        Photometry(response, colours),
        reasons,
        photos=len(photos.images),
        pixels=len(samples.drawn),
        rms_before=before,
        rms_after=after,
    )


def _write(record: str | Path, found: Photometry, reasons: list[str], **figures: Any) -> None:
    write_stage(record, reasons=reasons, response=asdict(found.response), robot_colours=dict(found.robot_colours), **figures)


@dataclass(frozen=True)
class _Samples:
    """Colours of the table as drawn and as seen in photos, [N, 3] each, and colours seen on each link, [K, 3]."""

    drawn: Array
    seen: Array
    links: dict[str, Array]

    @classmethod
    def of(cls, capture: BoardCapture, registration: Registration, robot: RobotFiles, background: Asset) -> _Samples:
        camera = capture.camera or registration.camera
        if camera is None:
            raise InputError(capture.folder, "the intrinsics of its camera are unknown", "Register the workspace again")
        small = camera.undistorted().scaled(WIDTH / camera.width)
        mesh = background.mesh()
        floor = Composition({}, with_underlay(background.cloud(), mesh))
        hand = _Hand(robot, mesh)
        kinematics = Kinematics.read(robot.urdf, robot.record["rest_posture"])
        drawn, seen, links = [], [], {name: [np.zeros((0, 3))] for name in hand.names}
        for index, name in enumerate(capture.images):
            photo = _shrunk(capture.folder / name, camera, small)
            if capture.joints is not None:
                q = np.append(capture.joints[index], robot.dimensions.angle(0.0))
                poses = {link: np.linalg.inv(registration.base_from_table) @ pose for link, pose in kinematics.fk(q).items()}
                table_from_camera = poses[robot.record["flange"]] @ registration.flange_from_camera
                labels = hand.labels(poses, small, np.linalg.inv(table_from_camera))
            else:
                assert capture.base_from_flange is not None
                flange = np.linalg.inv(registration.base_from_table) @ capture.base_from_flange[index]
                table_from_camera, labels = flange @ registration.flange_from_camera, None
            shot = shoot(floor, small, np.linalg.inv(table_from_camera))
            table = shot.alphas > OPAQUE
            if labels is not None:
                robot_near = cv2.dilate((labels > 0).astype(np.uint8), np.ones((2 * HAND_BORDER + 1,) * 2)) > 0
                table &= ~robot_near
                for number, link in enumerate(hand.names, start=1):
                    inside = cv2.erode((labels == number).astype(np.uint8), np.ones((3, 3))) > 0
                    links[link].append(photo[inside])
            drawn.append(shot.pixels[table] / 255.0)
            seen.append(photo[table])
        return cls(np.concatenate(drawn), np.concatenate(seen), {name: np.concatenate(v) for name, v in links.items()})


class _Hand:
    """Tells which link of the robot a pixel shows; what the table hides counts as table."""

    def __init__(self, robot: RobotFiles, table: Mesh) -> None:
        meshes = link_meshes(robot)
        self.names = tuple(meshes)
        # A link's number is its shade of grey.
        painted = {name: uniform(mesh, [number / 255.0] * 3) for number, (name, mesh) in enumerate(meshes.items(), start=1)}
        self._composition = MeshComposition(painted, uniform(table, [0.0] * 3))

    def labels(self, poses: Mapping[str, Array], camera: Camera, cam_from_table: Array) -> Array:
        """Return the number of the link that each pixel shows, from 1; 0 for the table. [H, W] uint8."""
        self._composition.pose({name: poses[name] for name in self.names})
        return self._composition.render(camera, cam_from_table, samples=1)[..., 0]


def _shrunk(path: Path, camera: Camera, small: Camera) -> Array:
    """A photo without distortion at the small camera's size, averaged as light. [h, w, 3], encoded 0..1."""
    light = linear_from_srgb(read_image(path).astype(np.float64)).astype(np.float32)
    if light.shape[:2] != (camera.height, camera.width):
        raise InputError(path, f"it is {light.shape[1]}x{light.shape[0]} px, its camera {camera.width}x{camera.height}",
                         "Use photos as the camera took them")  # fmt: skip
    if not camera.is_pinhole:
        # OpenCV counts pixel centres from 0, we from 0.5.
        matrix = replace(camera, cx=camera.cx - 0.5, cy=camera.cy - 0.5).intrinsics
        light = cv2.undistort(light, matrix, np.array(camera.distortion)).astype(np.float32)
    shrunk = cv2.resize(light, (small.width, small.height), interpolation=cv2.INTER_AREA)
    return np.asarray(srgb_from_linear(shrunk.astype(np.float64)))
