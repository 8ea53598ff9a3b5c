"""Throws of bodies whose truth is known, and the model of one."""

import numpy as np

from gsbridge.gap.benchmark.body_truth import ThrowScene, throw_box
from gsbridge.gap.contact.body import parse_body
from gsbridge.gap.contact.replay import ThrowReplay
from gsbridge.gap.contact.setup import body_setup
from gsbridge.gap.contact.starts import starts_of
from gsbridge.gap.contact.throws import Throw, Throws
from gsbridge.gap.contact.world import simulate

MODEL = {"box": [0.1, 0.1, 0.1], "mass": 0.4, "controller": {"mode": "body"}, "contact": {"friction": 0.5}}
HORIZON = 0.5
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def own_throws(friction, count, seed, scene=None, effects=()):
    """Throws whose truth is the simulator itself, with another friction and effects, and noise."""
    seeds = throw_box(scene or ThrowScene(duration=0.1), count, seed)
    starts, _ = starts_of(seeds)
    body = parse_body({**MODEL, "contact": {"friction": friction}}, ".")
    time = np.arange(75) / 150
    rng = np.random.default_rng(seed)
    flights = simulate(body, body_setup(body, effects), starts, [time] * count)
    return Throws(
        tuple(
            Throw(str(k), time, f.position + rng.normal(0, 1e-4, f.position.shape), f.quat, starts.velocity[k], starts.spin[k])
            for k, f in enumerate(flights)
        )
    )


def soft_ball(folder, inertia, friction=0.4):
    """Throws of a ball whose contacts last 4 ms, and the model of one whose contacts do not."""
    moments = " ".join(f'{axes}="{value}"' for axes, value in zip(_MOMENTS, [1.96e-4] * 3 + [0] * 3, strict=True))
    (folder / "ball.urdf").write_text(
        f'<robot name="ball"><link name="ball"><inertial><mass value="0.4"/><inertia {moments}/></inertial>'
        '<collision><geometry><sphere radius="0.035"/></geometry></collision></link></robot>'
    )
    model = {"urdf": "ball.urdf", "controller": {"mode": "body"}, "contact": {"friction": 0.4}}
    scene = {"friction": friction, "inertia": inertia, "slowness": 0.004, "duration": HORIZON, "noise": (5e-5, 5e-4)}
    return ThrowReplay(parse_body(model, folder), throw_box(ThrowScene("ball", (0.07,) * 3, **scene), 20, 5), HORIZON)
