"""What was filmed, with which camera, and where the table stands before the robot."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gsbridge.configuration.asset import Density
from gsbridge.configuration.base import ABSENT, Always, Given, Number, OneOf, OrNull, Settings, Sheet, Switch
from gsbridge.configuration.films import Film, Take


class SharedCamera(Settings):
    """A camera that several captures share."""

    calibrate_from: list[str] = Field(min_length=1)
    """Scenes whose photos of the board calibrate the camera. Only scenes of the preset are used, or all of these when the
    preset has none of them."""
    board: Sheet = "a4"
    """Sheet of the board in these scenes."""


class SourceSettings(OneOf):
    """Where the photos of a scene come from."""

    video: str = ABSENT
    """A video file; `~` is your home folder."""
    images: str = ABSENT
    """A folder of photos."""
    colmap: str = ABSENT
    """A folder with an existing COLMAP project or model and its images (docs/capture.md)."""
    nerfstudio: str = ABSENT
    """A nerfstudio `transforms.json`."""
    film: Film = ABSENT
    """A scene that the mirror's film studio films; the scene must carry the same name, with `_` and its `take` behind it where
    it has one."""


Point = tuple[str, Number, Number]
"""Name of a keyframe, u, v, in pixels of the files in `capture/frames`."""


class KnownLengthSettings(Given):
    """A length that gives the scale where no board was filmed; it belongs to `object` or `between`."""

    metres: Number = Field(gt=0.0001, lt=100)
    """The length, m."""
    object: Literal["longest"] = ABSENT
    """The length is that of the object's longest side. This is good to some 5 %, so that the scene stays degraded."""
    between: tuple[Point, Point] = ABSENT
    """Two points on the table, each as `[keyframe, u, v]`, in pixels of the files in `capture/frames` (docs/capture.md)."""


MaskPoint = tuple[str, Number, Number, Literal["keep", "drop"]]
"""Name of a photo, u, v, in pixels of the files in `sfm/images`, and whether the object is there."""


class SceneMasks(Settings):
    """What a person says about the masks of one scene."""

    points: list[MaskPoint] = Field(default_factory=list)
    """Pixels that belong to the object (`keep`) or do not (`drop`), each as `[photo, u, v, keep]`; read them off the sheet that
    `gsbridge masks SCENE` writes (docs/masks.md)."""


class Scene(Settings):
    """A capture of an object, or of an empty table."""

    kind: Literal["object", "background"]
    """An object standing on a table, or the empty table."""
    source: SourceSettings
    """Where the photos come from; exactly one of the keys below."""
    take: OrNull[Take] = None
    """How the mirror films it: with the phone held upright, with pictures stored on their side, at one height only, or with
    exposure and white balance left to the camera; null walks round it with the phone level, ever higher, exposure locked."""
    camera: OrNull[str] = None
    """Name of a shared camera; null calibrates from this capture alone. Not for `colmap` and `nerfstudio`, whose photos come
    with cameras."""
    board: OrNull[Sheet] = None
    """Sheet of the printed board; null where none was laid out."""
    require_scale: Switch = False
    """Stop when the metric scale cannot be found, instead of going on degraded."""
    known_length: OrNull[KnownLengthSettings] = None
    """A length that gives the scale where no board was filmed."""
    metres_per_unit: OrNull[Number] = Field(default=None, gt=0)
    """Length of one unit of a `colmap` or `nerfstudio` source, m, where its poses are metric (ARKit, Polycam and Record3D: 1).
    The scale of a board in the photos overrides it."""
    up: OrNull[Literal["top", "right", "bottom", "left"]] = None
    """Side of the photos that is up in the scene. Set it when the photos are turned or upside down and the table is not found;
    null finds the side by itself."""
    masks: SceneMasks = Field(default_factory=SceneMasks)
    """Help with the masks, where they take the wrong thing."""
    density: Density = "wood"
    """Density for the mass, kg/m3, or a material's name (docs/assets.md)."""
    example: Switch = False
    """Whether this is an example: without its files on this machine the scene is left out instead of stopping the run."""


Reach = Annotated[Number, Field(ge=-5, le=5)]


class Pose(Given):
    """A pose typed by hand; without `quaternion` and `rpy_deg` nothing is turned."""

    position: tuple[Reach, Reach, Reach]
    """x, y, z, m."""
    quaternion: tuple[Number, Number, Number, Number] = ABSENT
    """Orientation as w, x, y, z. Give either this or `rpy_deg`."""
    rpy_deg: tuple[Number, Number, Number] = ABSENT
    """Orientation as roll, pitch, yaw about fixed axes, as in URDF, degrees. Give either this or `quaternion`."""


class TypedPoses(Settings):
    """Poses typed by hand instead of a registration."""

    base_from_table: Pose
    """Pose of the table before the robot's base."""
    flange_from_camera: Pose
    """Pose of the camera on the flange."""


class WorkspaceSource(OneOf):
    """Where the registration comes from."""

    mirror: Always = ABSENT
    """The mirror's wrist camera films the board."""
    capture: str = ABSENT
    """A folder of photos of the board with `arm.csv` (docs/registration.md)."""
    typed: TypedPoses = ABSENT
    """Poses typed by hand. The result is then degraded."""


class WorkspaceSettings(Settings):
    """Where the table stands before the robot, and where the wrist camera sits."""

    source: WorkspaceSource = Field(default_factory=lambda: WorkspaceSource(mirror=True))
    """Where the registration comes from; exactly one of the keys below."""
    board: Sheet = "a4"
    """Sheet of the board that the wrist camera sees."""
    background: OrNull[str] = None
    """Scene of the table on which the wrist camera sees the board, with `require_scale: true`; it tells how that camera sees
    colours (docs/registration.md). With null, colours stay as the phone saw them."""
    light: OrNull[str] = None
    """Scene of an object that was filmed on that table in the light of the work place: its shadow tells where the light comes
    from (docs/registration.md). With null, no shadows are drawn. A film of the mirror draws none on a table of your own
    either."""
    scale: Literal["board", "robot"] = "board"
    """Which of the two sets the scale: the printed size of the board, or the motion of the arm."""
