"""Effects on camera images, one per file."""

from gsbridge.effects.images.base import ImageEffect
from gsbridge.effects.images.black_level import BlackLevel
from gsbridge.effects.images.defocus import Defocus
from gsbridge.effects.images.distortion import Distortion
from gsbridge.effects.images.exposure import Exposure
from gsbridge.effects.images.extrinsics import Extrinsics
from gsbridge.effects.images.flicker import Flicker
from gsbridge.effects.images.focal import Focal
from gsbridge.effects.images.hue_cast import HueCast
from gsbridge.effects.images.latency import Latency
from gsbridge.effects.images.motion_blur import MotionBlur
from gsbridge.effects.images.noise import Noise
from gsbridge.effects.images.response import Response
from gsbridge.effects.images.rolling_shutter import RollingShutter
from gsbridge.effects.images.saturation import Saturation
from gsbridge.effects.images.shadow import Shadow
from gsbridge.effects.images.vignetting import Vignetting
from gsbridge.effects.images.white_balance import WhiteBalance
from gsbridge.effects.registry import Registry

IMAGE_EFFECTS: Registry[ImageEffect] = Registry(
    BlackLevel,
    Defocus,
    Distortion,
    Exposure,
    Extrinsics,
    Flicker,
    Focal,
    HueCast,
    Latency,
    MotionBlur,
    Noise,
    Response,
    RollingShutter,
    Saturation,
    Shadow,
    Vignetting,
    WhiteBalance,
)
