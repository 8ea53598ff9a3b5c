"""MCAP logs: JSON messages, and ROS 2 joint states if the package for them is installed.

Three kinds of messages are read: joint states (`name`, `position`, `velocity`, `effort`), arrays in the joints' order
(`data`, the commands of ROS 2 controllers), and flat JSON objects of numbers, one per row, whose keys are our column names.

Source: https://mcap.dev/spec, sensor_msgs/JointState, REP 103 (units of ROS are SI).
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gsbridge.errors import InputError
from gsbridge.gap.formats.records import refuse_backwards
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file

MOST_MESSAGES = 2_000_000
"""Largest number of messages that are read from one topic: over five hours at 100 Hz."""

LARGEST_TOPICS = 512 * 2**20
"""Largest total size of the messages that are read, and largest size of one unpacked chunk, bytes."""

_HOLE, _BREAK = 10, 0.25
"""Time, in periods and in s (the longer one counts), for which the last command is taken to hold."""

_COMMANDED = {"position": "command", "velocity": "command_velocity", "effort": "feedforward"}
"""Our kinds of the columns of commanded joint states."""

UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N m", "N")}
"""Units of the joint states of ROS: at joints that turn, and at joints that slide."""


@dataclass(frozen=True)
class _Joints:
    """Names of a mechanism's joints, of those among them that slide, and whether torques drive them."""

    names: tuple[str, ...]
    sliding: Collection[str]
    torques: bool


@dataclass
class Stream:
    """Messages of one topic.

    Args:
        topic: Name of the topic.
        ros: Whether the messages are ROS messages, whose units are SI.
        times: Time stamps of the source, s; empty if not every message has one.
        logged: Time stamps of the log, s.
        messages: The messages as plain mappings.
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


def read_mcap(
    path: Path, part: str, joints: tuple[str, ...], sliding: Collection[str] = (), *, torques: bool = False
) -> tuple[pd.DataFrame, str, str]:
    """Read the log of a mechanism's joints as a table.

    Args:
        path: The file.
        part: `TOPIC` of the measurements, or `TOPIC,COMMANDS`; may be empty if only one topic has measurements.
        joints: Names of the mechanism's joints.
        sliding: Names of the joints that slide.
        torques: Whether the mechanism is driven by torques: of commanded joint states, only the efforts count then.

    Returns:
        The table, the file's SHA-256, and a sentence about what was left out (empty if everything was taken). The columns are
        `time [s]`, `position.joint` and so on, with units if the messages have them; each row has the last command sent.

    Raises:
        InputError: The package `mcap` is missing, the file is damaged or too large, a topic is missing or contains no known
            kind of message, or its time stamps run backwards.
    """
    reader = _optional("mcap.reader", path)
    regular_file(path, "record", "Check the path in the case")
    wanted = [name for name in part.split(",") if name] or [_only_topic(path, reader)]
    streams = _streams(path, reader, wanted)
    with refusing(path, "its messages do not fit together", "Log the same joints in every message"):
        table, cut = _table(streams, path, wanted, _Joints(joints, sliding, torques))
    with open(path, "rb") as file:
        return table, hashlib.file_digest(file, "sha256").hexdigest(), cut


def _only_topic(path: Path, reader: Any) -> str:
    """Return the only topic with measurements, judged by the first message of each topic.

    Raises:
        InputError: Several topics have measurements, or none.
    """
    streams = _streams(path, reader)
    found = [name for name, stream in streams.items() if stream.kind != "array"]
    if len(found) != 1:
        raise InputError(path, f"it has the topics {_listed(streams)}", f"Say which is measured: {path.name}#TOPIC,COMMANDS")
    return found[0]


def _table(streams: Mapping[str, Stream], path: Path, wanted: Sequence[str], joints: _Joints) -> tuple[pd.DataFrame, str]:
    """Make the joints' table from the wanted topics, and a sentence about what was left out; see `read_mcap`."""
    measured, cut = streams[wanted[0]], ""
    columns = _columns(measured, joints, "measured", path)
    if len(wanted) > 1:
        sent = streams[wanted[1]]
        both = bool(measured.times and sent.times)
        time, when = (np.array(s.times if both else s.logged) for s in (measured, sent))
        for values, name in ((time, wanted[0]), (when, wanted[1])):
            refuse_backwards(values, path, f"message {{row}} of '{name}'")
        rows = np.searchsorted(when, time, side="right") - 1
        known = (rows >= 0) & (time <= _commanded_until(when))
        if known.sum() < 2:
            raise InputError(path, f"no message of '{wanted[0]}' lies between those of '{wanted[1]}'", "Check the clocks")
        begins, ends = time[known][0], time[known][-1]
        if max(begins - time[0], time[-1] - ends) > _BREAK:
            cut = f"'{wanted[1]}' covers {begins - time[0]:.4g} to {ends - time[0]:.4g} s alone: only these were taken"
        columns = {name: values[known] for name, values in columns.items()}
        columns |= {
            name: values[rows[known]] for name, values in _columns(sent, joints, "command", path).items() if "." in name
        }
    return pd.DataFrame(columns), cut


def _commanded_until(when: Array) -> float:
    """Return the time until which the last command is taken to hold, s, from the time stamps of the commands. [T].

    A command from a steady stream holds for `_HOLE` periods or `_BREAK`. Commands that are sent only when something changes
    may hold longer: the last one is taken to hold for as long as the longest of the others.
    """
    if len(when) < 2:
        return np.inf
    steps = np.diff(when)
    return float(when[-1] + max(_BREAK, _HOLE * np.median(steps), steps.max()))


def _listed(streams: Mapping[str, Stream]) -> str:
    return ", ".join(streams) or "none that can be read"


def _optional(name: str, path: Path) -> Any:
    """Import a module of an optional package.

    Raises:
        InputError: The package is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            path, f"MCAP needs the package '{name.split('.')[0]}'", 'Install it: pip install "gsbridge[mcap]"'
        ) from error


def _streams(path: Path, reader: Any, wanted: Sequence[str] = ()) -> dict[str, Stream]:
    """Read the messages of topics, by topic, in the order of the log's time stamps.

    Args:
        path: The file.
        reader: The module `mcap.reader`.
        wanted: Topics to read; if empty, only the first message of each readable topic is read.

    Raises:
        InputError: The file is damaged, a topic is missing or cannot be read, or the messages exceed the limits.
    """
    out: dict[str, Stream] = {}
    closed: set[str] = set()
    others: set[str] = set()
    size = 0
    try:
        factories = [importlib.import_module("mcap_ros2.decoder").DecoderFactory()]
    except ImportError:
        factories = []
    mend = "Copy it again, or mend it with `mcap recover`"
    with refusing(path, "this is no whole MCAP file", mend), open(path, "rb") as stream:
        for schema, channel, message in _messages(reader.make_reader(stream), path, wanted):
            if not wanted and channel.topic in (out.keys() | closed | others):
                continue
            size += len(message.data)
            if size > LARGEST_TOPICS or (channel.topic in out and len(out[channel.topic].messages) >= MOST_MESSAGES):
                raise InputError(
                    path, f"its topics hold more than the {MOST_MESSAGES} messages or {LARGEST_TOPICS} bytes that are read",
                    "Cut the log into parts, e.g. with `mcap filter --start-secs --end-secs`",
                )  # fmt: skip
            content = _decoded(schema, channel, message, factories)
            if content is None:
                unknown = channel.message_encoding == "cdr" and not factories
                (closed if unknown else others).add(channel.topic)
                continue
            found = out.setdefault(channel.topic, Stream(channel.topic, channel.message_encoding == "cdr"))
            found.messages.append(content)
            found.logged.append(message.log_time * 1e-9)
            stamp = _stamp(content)
            if stamp is not None:
                found.times.append(stamp)
    if closed and (closed & set(wanted) or not out):
        raise InputError(
            path, "its ROS 2 messages need the package 'mcap-ros2-support'", 'Install it: pip install "gsbridge[mcap]"'
        )
    missing = [name for name in wanted if name not in out]
    if missing:
        there, asked = _listed(_streams(path, reader)), f"{path}#{','.join(wanted)}"
        raise InputError(asked, f"there is no topic '{missing[0]}' that can be read", f"It has: {there}")
    for found in out.values():
        # The source's stamps are used only if every message has one.
        if len(found.times) < len(found.messages):
            found.times = []
    return out


def _messages(reader: Any, path: Path, wanted: Sequence[str]) -> Iterator[Any]:
    """Yield the messages of the wanted topics in the order of the log's stamps, or those of all topics in the file's order.

    Raises:
        InputError: A chunk of the file would unpack to more than `LARGEST_TOPICS`.
    """
    summary = reader.get_summary()
    for chunk in summary.chunk_indexes if summary is not None else ():
        if chunk.uncompressed_size > LARGEST_TOPICS:
            raise InputError(path, "it has a chunk of more than 512 MB", "Write it with chunks of some megabytes")
    # Sorting a file without an index holds all its messages in memory, so only wanted topics are sorted.
    yield from reader.iter_messages(topics=list(wanted) or None, log_time_order=bool(wanted))


def _decoded(schema: Any, channel: Any, message: Any, factories: list[Any]) -> Mapping[str, Any] | None:
    """Decode a message into a plain mapping, or return None if that is impossible."""
    if channel.message_encoding == "json":
        content = json.loads(message.data)
        return content if isinstance(content, dict) else None
    for factory in factories:
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is not None:
            return _plain(decode(message.data))
    return None


def _plain(value: Any) -> Any:
    """Convert a decoded ROS message into nested mappings."""
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", None)
    return {name: _plain(getattr(value, name)) for name in names if not name.startswith("_")} if names else value


def _stamp(content: Mapping[str, Any]) -> float | None:
    """Return the time stamp in a message's header, s, or None if there is none."""
    stamp = (content.get("header") or {}).get("stamp") if isinstance(content.get("header"), Mapping) else None
    if not isinstance(stamp, Mapping):
        return None
    seconds = float(stamp.get("sec", 0)) + 1e-9 * float(stamp.get("nanosec", stamp.get("nsec", 0)))
    return seconds if seconds > 0 else None


def _columns(stream: Stream, joints: _Joints, role: str, path: Path) -> dict[str, Array]:
    """Return the columns of one topic, by header.

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
    commanded = {"effort": "command"} if joints.torques else _COMMANDED
    for kind, units in UNITS.items():
        ours = commanded.get(kind, "") if role == "command" else kind
        if not ours or len(stream.messages[0].get(kind) or []) != len(names):
            continue
        for joint in joints.names:
            if joint not in names:
                raise InputError(path, f"'{stream.topic}' has no joint '{joint}'", f"It has: {', '.join(names)}")
            column = np.array([_number(m[kind][list(m["name"]).index(joint)]) for m in stream.messages])
            out[f"{ours}.{joint}" + (f" [{units[joint in joints.sliding]}]" if stream.ros else "")] = column
    return out


def _number(value: Any) -> float:
    """Return a number as a float, and not-a-number for anything else."""
    return float(value) if isinstance(value, (int, float)) else float("nan")
