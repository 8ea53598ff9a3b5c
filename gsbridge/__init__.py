"""gsbridge: a phone video in, a robot policy out, and an honest account of the gap between simulation and reality.

The names that other programs use can be imported from here (docs/library.md). Each is loaded when it is first used, so that
`import gsbridge` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsbridge.cameras import Camera, View, Views, look_at, read_views
    from gsbridge.errors import GsbridgeError, InputError, StageError
    from gsbridge.geometry import Similarity
    from gsbridge.policy.export import Policy, load_policy
    from gsbridge.robot.urdf import read_description
    from gsbridge.splats.cloud import Cloud
    from gsbridge.splats.ply import read_ply, write_ply
    from gsbridge.splats.rasterize import Rendering, rasterize

__version__ = "0.1.0"

_HOMES = {
    "cameras": ("Camera", "View", "Views", "look_at", "read_views"),
    "errors": ("GsbridgeError", "InputError", "StageError"),
    "geometry": ("Similarity",),
    "policy.export": ("Policy", "load_policy"),
    "robot.urdf": ("read_description",),
    "splats.cloud": ("Cloud",),
    "splats.ply": ("read_ply", "write_ply"),
    "splats.rasterize": ("Rendering", "rasterize"),
}
"""Public names by the module that defines them."""


def __getattr__(name: str) -> object:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


__all__ = [
    "Camera",
    "Cloud",
    "GsbridgeError",
    "InputError",
    "Policy",
    "Rendering",
    "Similarity",
    "StageError",
    "View",
    "Views",
    "__version__",
    "load_policy",
    "look_at",
    "rasterize",
    "read_description",
    "read_ply",
    "read_views",
    "write_ply",
]
