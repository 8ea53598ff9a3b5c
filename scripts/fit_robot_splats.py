"""Fit splats to the links of the robot."""

from typing import TYPE_CHECKING

from gsbridge.environment.photometry import read_photometry
from gsbridge.environment.robot_splats import robot_splats, write_robot_splats
from gsbridge.logs import start
from gsbridge.robot.assembly import RobotFiles

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

start(snakemake.threads, snakemake.log[0])
colours = read_photometry(snakemake.input.photometry).robot_colours
splats = robot_splats(RobotFiles.read(snakemake.input.robot), colours=colours, seed=snakemake.params.seed)
write_robot_splats(snakemake.output.splats, splats)
