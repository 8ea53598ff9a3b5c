"""Recording of a case of the gap: measured, nominal and explained motion side by side, and the residuals over time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from gsbridge.files import read_json
from gsbridge.gap.contact.body import is_body
from gsbridge.gap.image.case import PHOTOS
from gsbridge.gap.joints.mechanism.chain import Chain
from gsbridge.gap.joints.mechanism.inertials import Skeleton
from gsbridge.gap.joints.mechanism.mechanism_model import MechanismModel, read_mechanism_model
from gsbridge.geometry import Array
from gsbridge.report.gap.sections import JUDGED, read_series
from gsbridge.report.recordings.gap_photos import record_photos
from gsbridge.report.recordings.gap_throws import COLOURS, WAYS, record_throws, summary
from gsbridge.report.recordings.recording import recording

FRAMES_PER_S = 25.0
"""Poses drawn per second; curves keep every sample."""

VISIBLE_RAD = 0.25
"""Approximate size to which the largest deviation is enlarged, rad or m: a milliradian would not be visible."""


def record_gap(
    model: str | Path, findings: str | Path, series: str | Path, replays: str | Path, case: str, out: str | Path
) -> None:
    """Record the motion of the record `verify`; `record_throws` and `record_photos` do so for cases of throws and pictures.

    Entities on the timeline `time` (s): `{way}/mechanism` and, grey, `{way}/measured` for each way of `WAYS`, with deviations
    from the measured motion enlarged; `plots/position/{joint}/{way}`, rad or m; `plots/residual/{channel}/before` and
    `/after`, in units of the noise; `summary`.

    Args:
        model: Model file of the case.
        findings: `findings.json`.
        series: `replays.npz`.
        replays: `replays.json`.
        case: Name of the case.
        out: The `.rrd`.

    Raises:
        InputError: A file is missing or damaged.
    """
    if is_body(model):
        record_throws(model, findings, series, case, out)
        return
    found, motion, rows = read_json(findings), read_series(series), read_json(replays)["records"][JUDGED]
    if PHOTOS in found:
        record_photos(found, motion, case, out)
        return
    system = read_mechanism_model(model)
    skeleton = Skeleton.read(system.urdf, system.joints)
    chain = Chain.of(skeleton, system.joints)
    centres = chain.bodies(skeleton.inertials)[:, 1:4]
    positions = {"measured": motion[f"{JUDGED}/position"], "nominal": motion[f"{JUDGED}/nominal_position"]}
    residuals = {"before": motion[f"{JUDGED}/before"]}
    if f"{JUDGED}/after" in motion:
        positions["explained"] = motion[f"{JUDGED}/explained_position"]
        residuals["after"] = motion[f"{JUDGED}/after"]
    factor = enlargement(positions)
    # If only the tool of an arm was measured, the joints are drawn at their commanded positions.
    known = "measured" if rows.get("joints_measured", True) else "commanded"
    enlarged = f"Deviations from the {known} motion are drawn {factor:g} times as large." if factor > 1 else ""
    time = motion[f"{JUDGED}/time"]
    ways = {**WAYS, "measured": known.capitalize()}
    with recording(out, "gap", case, _layout(tuple(positions), _with_units(system), rows["channels"], factor, ways)) as stream:
        stream.log("summary", rr.TextDocument(summary(found, enlarged), media_type="text/markdown"), static=True)
        _log_curves(stream, system.joints, rows["channels"], time, positions, residuals)
        _log_motion(stream, chain, centres, time, positions, factor)


def enlargement(positions: dict[str, Array]) -> float:
    """Factor by which deviations are enlarged: one digit, at least 1. Positions by way, rad or m, [T, N] each."""
    largest = max(
        (float(np.abs(np.nan_to_num(q - positions["measured"])).max()) for way, q in positions.items() if way != "measured"),
        default=0.0,
    )
    if largest <= 0.0:
        return 1.0
    factor = VISIBLE_RAD / largest
    digit = 10.0 ** np.floor(np.log10(factor))
    return float(max(1.0, np.floor(factor / digit) * digit))


def place_joints(chain: Chain, q: Array) -> Array:
    """Poses of the joints' frames in the base frame. [N] -> [N, 4, 4]."""
    out = np.empty((len(chain.parents), 4, 4))
    for row, (parent, fixed) in enumerate(zip(chain.parents, chain.fixed, strict=True)):
        move, value = np.eye(4), float(q[chain.order[row]])
        if chain.slides[row]:
            move[:3, 3] = value * chain.axes[row]
        else:
            move[:3, :3] = Rotation.from_rotvec(value * chain.axes[row]).as_matrix()
        out[row] = (np.eye(4) if parent < 0 else out[parent]) @ fixed @ move
    return out


def lines(chain: Chain, centres: Array, q: Array) -> Array:
    """Lines that stand for a mechanism: from joint to joint, and from each joint to the centre of the mass that it moves.

    Args:
        chain: The mechanism.
        centres: Centres of mass, joint frames, m. [N, 3].
        q: Joint positions in the order of the records, rad or m. [N].

    Returns:
        Pairs of points, base frame, m. [2 N, 2, 3].
    """
    poses = place_joints(chain, q)
    begins = np.stack([np.zeros(3) if parent < 0 else poses[parent][:3, 3] for parent in chain.parents])
    ends = np.einsum("nij,nj->ni", poses[:, :3, :3], centres) + poses[:, :3, 3]
    arms, masses = np.stack([begins, poses[:, :3, 3]], axis=1), np.stack([poses[:, :3, 3], ends], axis=1)
    return np.concatenate([arms, masses])


def _log_motion(
    stream: rr.RecordingStream, chain: Chain, centres: Array, time: Array, positions: dict[str, Array], factor: float
) -> None:
    """Log the mechanism of every way, with deviations enlarged by `factor`, beside the measured one."""
    reach = float(np.abs(lines(chain, centres, positions["measured"][0])).max())
    measured = positions["measured"]
    for row in range(0, len(time), max(1, round(1 / FRAMES_PER_S / float(np.median(np.diff(time)))))):
        stream.set_time("time", duration=float(time[row]))
        for way, q in positions.items():
            if way != "measured":
                thin = rr.LineStrips3D(lines(chain, centres, measured[row]), colors=[200, 206, 213], radii=0.006 * reach)
                stream.log(f"{way}/measured", thin)
            shown = measured[row] + factor * (q[row] - measured[row])
            if np.isfinite(shown).all():
                body = rr.LineStrips3D(lines(chain, centres, shown), colors=COLOURS[way], radii=0.012 * reach)
                stream.log(f"{way}/mechanism", body)


def _log_curves(
    stream: rr.RecordingStream,
    joints: tuple[str, ...],
    channels: list[str],
    time: Array,
    positions: dict[str, Array],
    residuals: dict[str, Array],
) -> None:
    """Log the positions of the joints and the residuals of all channels, every sample."""
    times = [rr.TimeColumn("time", duration=time.astype(np.float64))]
    for way, q in positions.items():
        for joint, column in zip(joints, q.T, strict=True):
            entity = f"plots/position/{joint}/{way}"
            stream.log(entity, rr.SeriesLines(names=WAYS[way], colors=COLOURS[way]), static=True)
            stream.send_columns(entity, times, rr.Scalars.columns(scalars=column.astype(np.float64)))
    for when, values in residuals.items():
        colour = COLOURS["nominal" if when == "before" else "explained"]
        for channel, column in zip(channels, values.T, strict=True):
            entity = f"plots/residual/{channel}/{when}"
            stream.log(entity, rr.SeriesLines(names=f"{channel} {when}", colors=colour), static=True)
            stream.send_columns(entity, times, rr.Scalars.columns(scalars=column.astype(np.float64)))


def _with_units(system: MechanismModel) -> dict[str, str]:
    """Unit of each joint's position."""
    return {joint: "m" if joint in system.sliding else "rad" for joint in system.joints}


def _layout(
    ways: tuple[str, ...], joints: Mapping[str, str], channels: list[str], factor: float, titles: Mapping[str, str]
) -> rrb.Container:
    """Mechanisms side by side above, curves below; `joints` maps each joint to the unit of its position."""
    enlarged = f", deviation × {factor:g}" if factor > 1 else ""
    spaces = [
        rrb.Spatial3DView(origin=way, name=titles[way] + ("" if way == "measured" else enlarged), contents="$origin/**")
        for way in ways
    ]
    plots = [
        rrb.TimeSeriesView(origin=f"plots/position/{joint}", name=f"Position of {joint}, {unit}")
        for joint, unit in joints.items()
    ]
    plots += [rrb.TimeSeriesView(origin=f"plots/residual/{name}", name=f"Residual of {name}, × noise") for name in channels]
    return rrb.Vertical(
        rrb.Horizontal(*spaces, rrb.TextDocumentView(origin="summary", name="Finding")), rrb.Grid(*plots), row_shares=[2, 3]
    )
