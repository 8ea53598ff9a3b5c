"""MCAP logs: JSON messages, and ROS 2 joint states where the package for them is installed.

Messages of three kinds are understood: joint states (`name`, `position`, `velocity`, `effort`), arrays in the joints' order
(`data`, as controllers of ROS 2 take them), and flat JSON objects of numbers, one row each, whose keys are our column names.

Source: https://mcap.dev/spec, sensor_msgs/JointState, REP 103 (units of ROS are SI).
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N m", "N")}
"""Units of the joint states of ROS: at joints that turn, and at those that slide."""


@dataclass(frozen=True)
class _Joints:
    """Joints of a mechanism, and those of them that slide."""

    names: tuple[str, ...]
    sliding: Collection[str]


@dataclass
class Stream:
    """Messages of one topic.

    Args:
        topic: Name of the topic.
        ros: Whether they are ROS messages, whose units are SI.
        times: Stamps of their source, or of the log where they have none, s.
        logged: Stamps of the log, s.
        messages: Plain mappings.
    """

    topic: str
    ros: bool
    times: list[float] = field(default_factory=list)
    logged: list[float] = field(default_factory=list)
    messages: list[Mapping[str, Any]] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """Kind of the messages: `states`, `array` or `flat`."""
        first = self.messages[0]
        if "name" in first and "position" in first:
            return "states"
        return "array" if isinstance(first.get("data"), (list, tuple)) else "flat"


def read_mcap(path: Path, part: str, joints: tuple[str, ...], sliding: Collection[str] = ()) -> tuple[pd.DataFrame, str]:
    """The joints' log as a table.

    Args:
        path: The file.
        part: `TOPIC` of the measurements, or `TOPIC,COMMANDS`; may be empty where only one topic has measurements.
        joints: Joints of the mechanism.
        sliding: Names of the joints that slide.

    Returns:
        Columns `time [s]`, `position.joint` and so on with units where the messages have them; commands as they were last sent
        at each measurement. And the file's SHA-256.

    Raises:
        InputError: The package `mcap` is missing, the file is damaged, or a topic is missing or holds nothing known.
    """
    streams = _streams(path)
    with refusing(path, "its messages do not fit together", "Log the same joints in every message"):
        return _table(streams, path, part, _Joints(joints, sliding)), hashlib.sha256(path.read_bytes()).hexdigest()


def _table(streams: Mapping[str, Stream], path: Path, part: str, joints: _Joints) -> pd.DataFrame:
    """The joints' log from the topics that are meant; see `read_mcap`."""
    wanted = [name for name in part.split(",") if name]
    for name in wanted:
        if name not in streams:
            raise InputError(f"{path}#{part}", f"there is no topic '{name}' that can be read", f"It has: {_listed(streams)}")
    if not wanted:
        wanted = [name for name, stream in streams.items() if stream.kind != "array"]
        if len(wanted) != 1:
            raise InputError(
                path, f"it has the topics {_listed(streams)}", f"Say which is measured: {path.name}#TOPIC,COMMANDS"
            )
    measured = streams[wanted[0]]
    columns = _columns(measured, joints, "measured", path)
    if len(wanted) > 1:
        sent = streams[wanted[1]]
        both = bool(measured.times and sent.times)
        time, when = (np.array(s.times if both else s.logged) for s in (measured, sent))
        rows = np.searchsorted(when, time, side="right") - 1
        known = rows >= 0
        if known.sum() < 2:
            raise InputError(path, f"all of '{wanted[0]}' lies before the first of '{wanted[1]}'", "Check the clocks")
        columns = {name: values[known] for name, values in columns.items()}
        columns |= {
            name: values[rows[known]] for name, values in _columns(sent, joints, "command", path).items() if "." in name
        }
    return pd.DataFrame(columns)


def _listed(streams: Mapping[str, Stream]) -> str:
    return ", ".join(streams) or "none that can be read"


def _optional(name: str, path: Path) -> Any:
    """A package that not everybody has.

    Raises:
        InputError: It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            path, f"MCAP needs the package '{name.split('.')[0]}'", 'Install it: pip install "gsbridge[mcap]"'
        ) from error


def _streams(path: Path) -> dict[str, Stream]:
    """All topics that can be read, by name."""
    reader = _optional("mcap.reader", path)
    out: dict[str, Stream] = {}
    closed: set[str] = set()
    try:
        factories = [importlib.import_module("mcap_ros2.decoder").DecoderFactory()]
    except ImportError:
        factories = []
    regular_file(path, "record", "Check the path in the case")
    mend = "Copy it again, or mend it with `mcap recover`"
    with refusing(path, "this is no whole MCAP file", mend), open(path, "rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            content = _decoded(schema, channel, message, factories)
            if content is None:
                if channel.message_encoding == "cdr" and not factories:
                    closed.add(channel.topic)
                continue
            found = out.setdefault(channel.topic, Stream(channel.topic, channel.message_encoding == "cdr"))
            found.messages.append(content)
            found.logged.append(message.log_time * 1e-9)
            stamp = _stamp(content)
            if stamp is not None:
                found.times.append(stamp)
    if not out and closed:
        raise InputError(
            path, "its ROS 2 messages need the package 'mcap-ros2-support'", 'Install it: pip install "gsbridge[mcap]"'
        )
    for found in out.values():
        # Stamps count only where every message has one.
        if len(found.times) < len(found.messages):
            found.times = []
    return out


def _decoded(schema: Any, channel: Any, message: Any, factories: list[Any]) -> Mapping[str, Any] | None:
    """A message as a plain mapping; None where it cannot be decoded."""
    if channel.message_encoding == "json":
        content = json.loads(message.data)
        return content if isinstance(content, dict) else None
    for factory in factories:
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is not None:
            return _plain(decode(message.data))
    return None


def _plain(value: Any) -> Any:
    """A decoded ROS message as mappings."""
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", None)
    return {name: _plain(getattr(value, name)) for name in names if not name.startswith("_")} if names else value


def _stamp(content: Mapping[str, Any]) -> float | None:
    """Stamp in a message's header, s; None where there is none."""
    stamp = (content.get("header") or {}).get("stamp") if isinstance(content.get("header"), Mapping) else None
    if not isinstance(stamp, Mapping):
        return None
    seconds = float(stamp.get("sec", 0)) + 1e-9 * float(stamp.get("nanosec", stamp.get("nsec", 0)))
    return seconds if seconds > 0 else None


def _columns(stream: Stream, joints: _Joints, role: str, path: Path) -> dict[str, Array]:
    """Columns of one topic.

    Args:
        stream: Messages of the topic.
        joints: Joints of the mechanism.
        role: `measured` or `command`.
        path: The file, for messages.
    """
    if not stream.messages:
        raise InputError(path, f"the topic '{stream.topic}' is empty", "Name another")
    time = np.array(stream.times or stream.logged)
    out: dict[str, Array] = {"time [s]": time - time[0]}
    if stream.kind == "flat":
        keys = [key for key, value in stream.messages[0].items() if isinstance(value, (int, float))]
        columns = {key: np.array([_number(m.get(key)) for m in stream.messages]) for key in keys}
        clock = next((key for key in keys if key.split("[")[0].strip() == "time"), None)
        return columns if clock else {**out, **columns}
    if stream.kind == "array":
        rows = [m["data"] for m in stream.messages]
        if any(len(row) != len(joints.names) for row in rows):
            raise InputError(
                path, f"'{stream.topic}' holds {len(rows[0])} numbers for {len(joints.names)} joints", "Name another topic"
            )
        kind = "command" if role == "command" else "position"
        table = np.array(rows, dtype=np.float64)
        return {**out, **{f"{kind}.{joint}": column for joint, column in zip(joints.names, table.T, strict=True)}}
    names = [str(name) for name in stream.messages[0]["name"]]
    for kind, units in UNITS.items():
        if len(stream.messages[0].get(kind) or []) != len(names):
            continue
        for joint in joints.names:
            if joint not in names:
                raise InputError(path, f"'{stream.topic}' has no joint '{joint}'", f"It has: {', '.join(names)}")
            column = np.array([_number(m[kind][list(m["name"]).index(joint)]) for m in stream.messages])
            ours = (
                {"position": "command", "velocity": "command_velocity", "effort": "feedforward"}[kind]
                if role == "command"
                else kind
            )
            out[f"{ours}.{joint}" + (f" [{units[joint in joints.sliding]}]" if stream.ros else "")] = column
    return out


def _number(value: Any) -> float:
    """A number, not-a-number for everything else."""
    return float(value) if isinstance(value, (int, float)) else float("nan")
