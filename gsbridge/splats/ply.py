"""The standard 3DGS PLY file, which SuperSplat and other viewers open.

Each splat has the 32-bit little-endian values `x y z nx ny nz f_dc_0..2 f_rest_* opacity scale_0..2 rot_0..3`. `f_dc` is the
coefficient of the constant spherical harmonic, `opacity` a logit, `scale` a natural logarithm and `rot` a quaternion wxyz.
`f_rest_*` are the K other harmonics (`gsbridge.splats.harmonics`) by channel: all of red, then green, then blue; degree 0 has
none.

Source: Kerbl et al., 3D Gaussian Splatting, 2023 (file layout of the reference implementation).
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from gsbridge.errors import InputError
from gsbridge.files import atomic_file
from gsbridge.geometry import Array
from gsbridge.reading import refusing, regular_file
from gsbridge.splats.cloud import SH_C0, Cloud
from gsbridge.splats.harmonics import TERMS

PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
"""Properties of splats whose colours do not depend on direction; otherwise `f_rest_*` come before the opacity."""

_OPACITY = PROPERTIES.index("opacity")

SMALLEST_SCALE = 1e-9
"""Smallest scale that is written, m: scales are stored as logarithms, so zero is not possible."""

OPACITY_MARGIN = 1e-6
"""Smallest distance of a written opacity from 0 and 1: opacities are stored as logits, so 0 and 1 are not possible."""

LARGEST_PLY = 2 * 2**30
"""Largest size of a file that is read, bytes: 8 million splats with all harmonics, 31 million without."""

_LARGEST_HEADER = 2**16
"""Largest header that is read, bytes; the header of splats with all harmonics has one or two kilobytes."""

_SHORTEST_QUAT = 1e-30
"""Length below which a quaternion counts as zero."""

_TYPES = {
    **{
        "char": "i1",
        "int8": "i1",
        "uchar": "u1",
        "uint8": "u1",
        "short": "<i2",
        "int16": "<i2",
        "ushort": "<u2",
        "uint16": "<u2",
    },
    **{"int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4", "float": "<f4", "float32": "<f4"},
    **{"double": "<f8", "float64": "<f8"},
}

_REMEDY = "Delete it and run the splats stage again, or export it again from the program that wrote it"


def write_ply(path: str | Path, cloud: Cloud) -> None:
    """Write a cloud, whole or not at all.

    Raises:
        ValueError: A value is not finite.
    """
    opacity = np.clip(cloud.opacities.astype(np.float64), OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    rest = 3 * cloud.harmonics.shape[1]
    names = (*PROPERTIES[:_OPACITY], *_rest_names(rest), *PROPERTIES[_OPACITY:])
    table = np.zeros((len(cloud), len(names)), dtype="<f4")
    table[:, 0:3] = cloud.means
    table[:, 6:9] = (cloud.colours - 0.5) / SH_C0
    table[:, 9 : 9 + rest] = cloud.harmonics.swapaxes(1, 2).reshape(len(cloud), rest)
    table[:, 9 + rest] = np.log(opacity / (1 - opacity))
    table[:, 10 + rest : 13 + rest] = np.log(np.maximum(cloud.scales, SMALLEST_SCALE))
    table[:, 13 + rest :] = cloud.quats
    if not np.isfinite(table).all():
        raise ValueError("a splat holds a value that is not finite")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [f"property float {name}" for name in names]
    with atomic_file(path) as temporary:
        temporary.write_bytes(("\n".join([*header, "end_header"]) + "\n").encode("ascii") + table.tobytes())


def _rest_names(count: int) -> tuple[str, ...]:
    return tuple(f"f_rest_{k}" for k in range(count))


def read_ply(path: str | Path) -> Cloud:
    """Read a cloud.

    Raises:
        InputError: The file is missing, damaged, or not a 3DGS PLY.
    """
    source = regular_file(path, "splat file", "Check the path, or run the splats stage", LARGEST_PLY)
    with refusing(source, "the splat file cannot be read", _REMEDY), open(source, "rb") as file:
        table = _vertices(source, file)
    missing = [name for name in PROPERTIES if name not in (table.dtype.names or ()) and name not in ("nx", "ny", "nz")]
    if missing:
        raise InputError(source, f"the PLY is no Gaussian splat file: {', '.join(missing)} missing", _REMEDY)
    rest = {name for name in table.dtype.names or () if name.startswith("f_rest_")}
    if len(rest) not in [3 * terms for terms in TERMS] or rest != set(_rest_names(len(rest))):
        known = ", ".join(str(3 * terms) for terms in TERMS)
        raise InputError(source, f"it has {len(rest)} f_rest_*; those of degree 0 to 3 are {known}, from f_rest_0 on", _REMEDY)

    with np.errstate(over="ignore", invalid="ignore"):
        # Check the values as float32, as a cloud stores them: a double may be beyond that range.
        needed = (*PROPERTIES[:3], *PROPERTIES[6:], *_rest_names(len(rest)))
        broken = [name for name in needed if not np.isfinite(table[name].astype(np.float32)).all()]
    if broken:
        raise InputError(source, f"a splat holds a value that is no number, or too large, as its {broken[0]}", _REMEDY)

    def columns(*names: str) -> Array:
        if not names:
            return np.zeros((len(table), 0))
        return np.stack([table[name].astype(np.float64) for name in names], axis=-1)

    quats = columns("rot_0", "rot_1", "rot_2", "rot_3")
    length = np.linalg.norm(quats, axis=1, keepdims=True)
    if np.any(length < _SHORTEST_QUAT):
        raise InputError(source, "a splat's quaternion is zero", _REMEDY)
    harmonics = columns(*_rest_names(len(rest)))
    return Cloud(
        columns("x", "y", "z"),
        quats / length,
        np.exp(np.clip(columns("scale_0", "scale_1", "scale_2"), -60, 60)),
        1 / (1 + np.exp(-np.clip(table["opacity"].astype(np.float64), -60, 60))),
        columns("f_dc_0", "f_dc_1", "f_dc_2") * SH_C0 + 0.5,
        harmonics.reshape(len(table), 3, -1).swapaxes(1, 2),
    )


def _vertices(source: Path, file: BinaryIO) -> Array:
    """Read the vertex table of a binary little-endian PLY. [N] structured."""
    header = file.read(_LARGEST_HEADER)
    begin = header.find(b"end_header")
    end = header.find(b"\n", begin) + 1
    if not header.startswith(b"ply") or begin < 0 or end == 0:
        raise InputError(source, "this is no PLY file, or its header is cut off or too long", _REMEDY)
    lines = [line.split() for line in header[:begin].decode("ascii", errors="replace").splitlines()]
    if ["format", "binary_little_endian", "1.0"] not in lines:
        raise InputError(source, "only binary little-endian PLY files are read", _REMEDY)
    fields: dict[str, str] = {}
    count, element = 0, ""
    for words in lines:
        if words[:1] == ["element"] and len(words) == 3:
            if not element and words[1] != "vertex":
                raise InputError(source, "the PLY does not begin with its vertices", _REMEDY)
            element = words[1]
            if element == "vertex":
                if not words[2].isdigit():
                    raise InputError(source, f"the number of vertices reads {words[2][:40]!r}", _REMEDY)
                count = int(words[2])
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES or words[2] in fields:
                raise InputError(source, f"the header line {' '.join(words)[:80]!r} is not understood", _REMEDY)
            fields[words[2]] = _TYPES[words[1]]
    row = np.dtype(list(fields.items()))
    if count == 0 or not fields:
        raise InputError(source, "the PLY holds no splat", _REMEDY)
    if source.stat().st_size - end < count * row.itemsize:
        raise InputError(source, f"the file is cut off: {count} splats announced, fewer there", _REMEDY)
    file.seek(end)
    return np.fromfile(file, row, count)
