"""Write the robot's description, with the camera at the pose that the registration found."""

from typing import TYPE_CHECKING

import numpy as np

from gsbridge.files import read_json
from gsbridge.logs import start
from gsbridge.robot.assembly import build_robot

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
build_robot(
    snakemake.output.robot,
    flange_from_camera=np.array(read_json(snakemake.input.registration)["flange_from_camera"]),
)
