"""Effects on thrown and sliding bodies, one per file."""

from gsbridge.effects.bodies.angular_damping import AngularDamping
from gsbridge.effects.bodies.base import BodyEffect
from gsbridge.effects.bodies.contact_friction import ContactFriction
from gsbridge.effects.bodies.contact_softness import ContactSoftness
from gsbridge.effects.bodies.gravity_scale import GravityScale
from gsbridge.effects.bodies.inertia_scale import InertiaScale
from gsbridge.effects.bodies.linear_damping import LinearDamping
from gsbridge.effects.bodies.object_com import ObjectCom
from gsbridge.effects.bodies.object_mass import ObjectMass
from gsbridge.effects.bodies.object_size import ObjectSize
from gsbridge.effects.bodies.restitution import Restitution
from gsbridge.effects.bodies.rolling_friction import RollingFriction
from gsbridge.effects.bodies.spinning_friction import SpinningFriction
from gsbridge.effects.bodies.steady_force import SteadyForce
from gsbridge.effects.bodies.table_height import TableHeight
from gsbridge.effects.bodies.table_tilt import TableTilt
from gsbridge.effects.bodies.tracking_lag import TrackingLag
from gsbridge.effects.bodies.tracking_offset import TrackingOffset
from gsbridge.effects.bodies.tracking_rate import TrackingRate
from gsbridge.effects.bodies.tracking_scale import TrackingScale
from gsbridge.effects.registry import Registry

BODY_EFFECTS: Registry[BodyEffect] = Registry(
    AngularDamping,
    ContactFriction,
    ContactSoftness,
    GravityScale,
    InertiaScale,
    LinearDamping,
    ObjectCom,
    ObjectMass,
    ObjectSize,
    Restitution,
    RollingFriction,
    SpinningFriction,
    SteadyForce,
    TableHeight,
    TableTilt,
    TrackingLag,
    TrackingOffset,
    TrackingRate,
    TrackingScale,
)
