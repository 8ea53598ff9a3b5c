"""Effects of driven joints, one per file."""

from gsbridge.effects.joints.armature import Armature
from gsbridge.effects.joints.backlash import Backlash
from gsbridge.effects.joints.base import JointEffect
from gsbridge.effects.joints.base_tilt import BaseTilt
from gsbridge.effects.joints.clock_drift import ClockDrift
from gsbridge.effects.joints.clock_offset import ClockOffset
from gsbridge.effects.joints.command_delay import CommandDelay
from gsbridge.effects.joints.compliance import Compliance
from gsbridge.effects.joints.coulomb import Coulomb
from gsbridge.effects.joints.coulomb_asym import CoulombAsym
from gsbridge.effects.joints.damping import Damping
from gsbridge.effects.joints.eccentricity import Eccentricity
from gsbridge.effects.joints.effort_offset import EffortOffset
from gsbridge.effects.joints.encoder_offset import EncoderOffset
from gsbridge.effects.joints.encoder_scale import EncoderScale
from gsbridge.effects.joints.gain_d import GainD
from gsbridge.effects.joints.gain_p import GainP
from gsbridge.effects.joints.gravcomp import Gravcomp
from gsbridge.effects.joints.lag import Lag
from gsbridge.effects.joints.link_mass import LinkMass
from gsbridge.effects.joints.load_friction import LoadFriction
from gsbridge.effects.joints.payload import Payload
from gsbridge.effects.joints.quadratic_drag import QuadraticDrag
from gsbridge.effects.joints.rate_limit import RateLimit
from gsbridge.effects.joints.ripple import Ripple
from gsbridge.effects.joints.saturation import Saturation
from gsbridge.effects.joints.spring import Spring
from gsbridge.effects.joints.stribeck import Stribeck
from gsbridge.effects.joints.table import Table
from gsbridge.effects.joints.torque_delay import TorqueDelay
from gsbridge.effects.joints.torque_gain import TorqueGain
from gsbridge.effects.joints.torque_lag import TorqueLag
from gsbridge.effects.joints.viscous import Viscous
from gsbridge.effects.joints.warming import Warming
from gsbridge.effects.registry import Registry

JOINT_EFFECTS: Registry[JointEffect] = Registry(
    Armature,
    Backlash,
    BaseTilt,
    ClockDrift,
    ClockOffset,
    CommandDelay,
    Compliance,
    Coulomb,
    CoulombAsym,
    Damping,
    Eccentricity,
    EffortOffset,
    EncoderOffset,
    EncoderScale,
    GainD,
    GainP,
    Gravcomp,
    Lag,
    LinkMass,
    LoadFriction,
    Payload,
    QuadraticDrag,
    RateLimit,
    Ripple,
    Saturation,
    Spring,
    Stribeck,
    Table,
    TorqueDelay,
    TorqueGain,
    TorqueLag,
    Viscous,
    Warming,
)
