"""Reading of logs in any known format (CSV, Parquet, LeRobot data sets, MCAP) as records.

Every format is turned into a table with our columns, and the same code then reads and checks that table.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gsbridge.errors import InputError
from gsbridge.gap.formats.lerobot import read_lerobot
from gsbridge.gap.formats.mcap import read_mcap
from gsbridge.gap.formats.records import Layout, Record, read_record, record_of
from gsbridge.reading import regular_file

OTHERS: Mapping[str, tuple[str, str]] = {
    ".mat": ("a file of MATLAB", "Write it as CSV there: writetable(array2table([t q], 'VariableNames', names), 'log.csv')"),
    **dict.fromkeys(
        (".npz", ".npy"),
        ("a file of NumPy", "Write it as CSV: pandas.DataFrame(array, columns=names).to_csv('{1}.csv', index=False)"),
    ),
    **dict.fromkeys(
        (".pkl", ".pickle", ".h5", ".hdf5", ".feather"),
        ("a file of Python's tools", "Write it as CSV: load it with pandas, then .to_csv('{1}.csv', index=False)"),
    ),
    ".ulg": ("a log of PX4", "Convert it: pip install pyulog; ulog2csv {0}"),
    ".xls": ("a spreadsheet", "Save it as CSV, with commas between the columns and points in decimals"),
    ".xlsx": ("a spreadsheet", "Save it as CSV, with commas between the columns and points in decimals"),
    ".bag": ("a bag of ROS 1", "Convert it: pip install rosbags; rosbags-convert --src {0} --dst {1} --dst-storage mcap"),
    ".db3": ("a bag of ROS 2 in SQLite", "Convert its folder: rosbags-convert --src {2} --dst {2}_mcap --dst-storage mcap"),
}
"""Formats that are not read, by file name ending: a description, and advice on how to convert them."""


def _refuse_others(file: Path) -> None:
    """Refuse logs in formats that are not read, and ROS 2 bags that are named by their folder.

    Raises:
        InputError: The log is such a file or folder; the message says how to convert or name it.
    """
    bag = sorted(file.glob("*.mcap")) + sorted(file.glob("*.db3")) if os.path.isfile(file / "metadata.yaml") else []
    if bag and bag[0].suffix == ".mcap":
        raise InputError(file, "this is the folder of a bag of ROS 2", f"Name the file in it: {bag[0].name}#TOPIC,COMMANDS")
    named = bag[0] if bag else file
    if named.suffix.lower() in OTHERS:
        what, way = OTHERS[named.suffix.lower()]
        raise InputError(
            file, f"this is {what}, which is not read", way.format(named.name, named.stem, named.parent.name or ".")
        )


def split_part(path: str | Path) -> tuple[Path, str]:
    """Split a log's path into its file and the part after `#`: `data#3` is episode 3, `log.mcap#/joint_states` a topic."""
    name, mark, part = str(path).partition("#")
    return Path(name), part if mark else ""


def read_log(path: str | Path, layout: Layout) -> Record:
    """Read a record from a log of any known format.

    Args:
        path: CSV or Parquet; the folder of a LeRobot data set with `#EPISODE`; an MCAP file with `#TOPIC` or `#TOPIC,COMMANDS`.
        layout: Names and units of the columns.

    Raises:
        InputError: For the reasons listed at `read_record`; the format is not read, the part is missing or ambiguous, or an
            optional package is not installed.
    """
    file, part = split_part(path)
    _refuse_others(file)
    if file.suffix.lower() == ".mcap":
        table, digest, cut = read_mcap(file, part, layout.joints, layout.sliding, torques=layout.torque_mode)
    elif os.path.isdir(file):
        (table, digest), cut = read_lerobot(file, part, layout.joints), ""
    elif part:
        regular_file(file, "record", "Check the path in the case")
        raise InputError(path, "only data sets and MCAP files have parts", "Leave out what stands behind '#'")
    else:
        return read_record(file, layout)
    record = record_of(table, Path(path), layout, digest=digest, headers=False)
    return replace(record, name=f"{file.stem}#{part}" if part else file.stem, cut=cut)
