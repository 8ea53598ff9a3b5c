"""Settings of what is looked at and counted: views, trials, episodes, and the figures and tables about splats."""

from __future__ import annotations

from pydantic import Field

from gsbridge.configuration.base import Distinct, Number, OrNull, PictureSize, Samples, Settings, Switch, Whole


class ViewSettings(Settings):
    """Pictures of the wrist camera that are compared between renderers."""

    count: Whole = Field(default=32, ge=1, le=32)
    """Number of start poses; one moment of the episode from each is drawn."""
    size: PictureSize = 128
    """Edge of the square pictures, px."""
    samples: Samples = 128
    """Samples per pixel of the mirror's pictures, at least."""


class TrialSettings(Settings):
    """Trials of the baseline controller and of policies."""

    poses: Whole = Field(default=32, ge=1, le=32)
    """Start poses of each set inside the square of the training, evenly over the quadrants."""
    outside: Whole = Field(default=16, ge=0, le=32)
    """Start poses of policies beyond that square, where the tool still reaches; 0 for none."""
    seeds: Whole = Field(default=3, ge=1, le=100)
    """Number of sets of start poses from which the controller is tried, each drawn with its own seed."""
    worlds: Distinct[str] = Field(default=["mirror"])
    """Worlds in which policies are tried beside the simulated one, by name."""
    policies: Whole = Field(default=1, ge=1, le=100)
    """Number of policies of each cell, each trained with its own seed; their trials are counted together."""


class EpisodeSettings(Settings):
    """Recording of one episode."""

    size: PictureSize = 64
    """Edge of the square pictures, px."""
    samples: Samples = 32
    """Samples per pixel of the mirror's pictures, at least."""
    every: Whole = Field(default=2, ge=1, le=1000)
    """Steps of the episode between two pictures of the mirror."""


class ComparisonSettings(Settings):
    """Extra trainings of splats for the table."""

    seeds: Whole = Field(default=3, ge=1, le=20)
    """Seeds of soft and GaMeS, with vertices frozen and free, in the comparison; the main run's among them."""
    hull: Switch = True
    """Whether soft and GaMeS are also trained on the visual hull of the mirror's objects, a poor mesh."""


class EditingSettings(Settings):
    """What the figure of non-rigid edits shows."""

    scene: OrNull[str] = None
    """Object that is deformed; null is the first object of the preset."""
    azimuth_deg: Number = Field(default=270.0, ge=-360, le=360)
    """Direction from which the object is seen, as an angle about the table frame's z, counted from +x, degrees; the camera of
    the nearest held-out photo is used."""
    size: Whole = Field(default=400, ge=64, le=2048)
    """Edge of each picture, px."""
