"""Effects of a model on the object: parameters of body, contact and surface that they change before the simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from gsbridge.effects.bodies import BODY_EFFECTS
from gsbridge.geometry import Array
from gsbridge.robot.urdf import read_description
from gsbridge.sim.model import Model, Surface

_BOUNDS = MappingProxyType(
    {
        "friction": (0.0, 5.0), "restitution": (0.0, 1.0), "rolling_friction": (0.0, 1.0), "spinning_friction": (0.0, 1.0),
        "compliance": (0.0, 1.0), "contact_damping": (0.0, 1e6), "mass": (1e-3, 1e3), "inertia": (0.05, 20.0),
        "gravity": (0.0, 100.0), "linear_damping": (0.0, 100.0), "angular_damping": (0.0, 100.0),
    }
)  # fmt: skip
"""Bounds within which effects can change a parameter."""


class ItemSetup:
    """The object with the model's effects on it; a `gsbridge.effects.bodies.base.BodyFigures`.

    Args:
        model: The simulation model.

    Attributes:
        figures: Parameters by the names of `gsbridge.gap.contact.setup.BOUNDS`: contact with the table; mass and inertia as
            factors on the asset's; compliance (m/N) and damping (N s/m) of the table; by how much the centre of mass is moved,
            m; height (m) and tilt (rad) of the table; a steady force, N; d of losses `v' = -d v`, 1/s; gravity, m/s2.
    """

    def __init__(self, model: Model) -> None:
        table = model.contact.table
        self.figures = {
            "friction": table.friction, "restitution": table.restitution, "rolling_friction": table.rolling_friction,
            "spinning_friction": table.spinning_friction, "compliance": 0.0, "contact_damping": 0.0,
            "mass": model.object.mass, "inertia": 1.0, "gravity": model.gravity,
            **dict.fromkeys(("linear_damping", "angular_damping", "force_x", "force_y", "height", "tilt_x", "tilt_y"), 0.0),
            **dict.fromkeys(("com_x", "com_y", "com_z"), 0.0),
        }  # fmt: skip
        for applied in model.effects_on("body"):
            BODY_EFFECTS[applied.name].apply(self, applied.parameters)

    def add(self, figure: str, change: float) -> None:
        """Add to a parameter, within its bounds."""
        self._put(figure, self.figures[figure] + change)

    def multiply(self, figure: str, change: float) -> None:
        """Change a parameter by a share of itself, within its bounds."""
        self._put(figure, self.figures[figure] * (1.0 + change))

    def _put(self, figure: str, value: float) -> None:
        low, high = _BOUNDS.get(figure, (-np.inf, np.inf))
        self.figures[figure] = min(max(value, low), high)

    def table(self, model: Model) -> Surface:
        """Contact of the object with the table."""
        f = self.figures
        names = ("friction", "restitution", "rolling_friction", "spinning_friction")
        return replace(model.contact.table, **{name: f[name] for name in names})

    def table_pose(self) -> Array:
        """Pose of the table's top in the table frame. [4, 4]."""
        out = np.eye(4)
        out[:3, :3] = Rotation.from_euler("xyz", [self.figures["tilt_x"], self.figures["tilt_y"], 0.0]).as_matrix()
        out[2, 3] = self.figures["height"]
        return out

    @property
    def soft(self) -> bool:
        """Whether the contact with the table is soft."""
        return self.figures["compliance"] > 0.0

    @property
    def pushes(self) -> bool:
        """Whether something acts on the object besides gravity and contacts."""
        return any(self.figures[name] for name in ("linear_damping", "angular_damping", "force_x", "force_y"))

    def pushed(self, velocity: Array, spin: Array, mass: float, step: float) -> tuple[Array, Array]:
        """Velocity and spin after one step of the steady force and of the losses in the air alone.

        Args:
            velocity: Velocity of the centre of mass, m/s. [3].
            spin: rad/s. [3].
            mass: Mass of the object, kg.
            step: Step of time, s.
        """
        f = self.figures
        kept, turning = (float(np.exp(-step * f[name])) for name in ("linear_damping", "angular_damping"))
        force = np.array([f["force_x"], f["force_y"], 0.0])
        return kept * velocity + step * force / mass, turning * spin

    def description(self, urdf: Path) -> str | None:
        """The object's URDF with its centre of mass moved, meshes named by absolute paths; None if it stays."""
        moved = np.array([self.figures[f"com_{axis}"] for axis in "xyz"])
        if not moved.any():
            return None
        root = read_description(urdf).root
        for origin in root.iterfind("link/inertial/origin"):
            place = np.array([float(value) for value in origin.get("xyz", "0 0 0").split()]) + moved
            origin.set("xyz", " ".join(repr(float(value)) for value in place))
        for mesh in root.iter("mesh"):
            mesh.set("filename", str((urdf.parent / mesh.get("filename", "")).absolute()))
        return ElementTree.tostring(root, encoding="unicode")
