"""Real spherical harmonics of degree 1 to 3: the dependence of a splat's colour on the viewing direction.

Seen along the unit direction d from the camera to its centre, a splat shows `max(colour + sum_k h_k Y_k(d), 0)`. This is the
convention of 3D Gaussian splatting, with the constant term already in `colour`. Within a degree l the functions are ordered
from m = -l to l; they are `sqrt(2) Im Y_l^|m|`, `Y_l^0` and `sqrt(2) Re Y_l^m` with the Condon-Shortley phase.

Harmonics turn with their splat: what the film saw from one side of an object is shown from that side in every pose of the
object. The lamp does not turn, so a highlight on a moved object is the one that the film's lamp made, not one of the room's.

Source: Kerbl et al., "3D Gaussian splatting", 2023; Sloan, "Stupid spherical harmonics tricks", 2008 (the polynomials).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from gsbridge.geometry import Array

TERMS = (0, 3, 8, 15)
"""Number of harmonics besides the constant one, by degree."""

_1 = math.sqrt(3 / (4 * math.pi))
_2A = math.sqrt(15 / (4 * math.pi))
_2B = math.sqrt(5 / (16 * math.pi))
_2C = math.sqrt(15 / (16 * math.pi))
_3A = math.sqrt(35 / (32 * math.pi))
_3B = math.sqrt(105 / (4 * math.pi))
_3C = math.sqrt(21 / (32 * math.pi))
_3D = math.sqrt(7 / (16 * math.pi))
_3E = math.sqrt(105 / (16 * math.pi))


def first(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the values of the three functions of degree 1.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    return -_1 * y, _1 * z, -_1 * x


def second(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the values of the five functions of degree 2.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    return (
        _2A * x * y,
        -_2A * y * z,
        _2B * (2.0 * z * z - x * x - y * y),
        -_2A * x * z,
        _2C * (x * x - y * y),
    )


def third(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the values of the seven functions of degree 3.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    return (
        -_3A * y * (3.0 * x * x - y * y),
        _3B * x * y * z,
        -_3C * y * (4.0 * z * z - x * x - y * y),
        _3D * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -_3C * x * (4.0 * z * z - x * x - y * y),
        _3E * z * (x * x - y * y),
        -_3A * x * (x * x - 3.0 * y * y),
    )


def first_slopes(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the derivatives of `first` by x, y and z, function by function: nine values.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    zero = 0.0 * x
    return zero, zero - _1, zero, zero, zero, zero + _1, zero - _1, zero, zero


def second_slopes(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the derivatives of `second` by x, y and z, function by function: fifteen values.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    zero = 0.0 * x
    return (
        *(_2A * y, _2A * x, zero),
        *(zero, -_2A * z, -_2A * y),
        *(-2.0 * _2B * x, -2.0 * _2B * y, 4.0 * _2B * z),
        *(-_2A * z, zero, -_2A * x),
        *(2.0 * _2C * x, -2.0 * _2C * y, zero),
    )


def third_slopes(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the derivatives of `third` by x, y and z, function by function: twenty-one values.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays, tensors, or a kernel's lanes.
    """
    xx, yy, zz = x * x, y * y, z * z
    return (
        *(-6.0 * _3A * x * y, -3.0 * _3A * (xx - yy), 0.0 * x),
        *(_3B * y * z, _3B * x * z, _3B * x * y),
        *(2.0 * _3C * x * y, -_3C * (4.0 * zz - xx - 3.0 * yy), -8.0 * _3C * y * z),
        *(-6.0 * _3D * x * z, -6.0 * _3D * y * z, _3D * (6.0 * zz - 3.0 * xx - 3.0 * yy)),
        *(-_3C * (4.0 * zz - 3.0 * xx - yy), 2.0 * _3C * x * y, -8.0 * _3C * x * z),
        *(2.0 * _3E * x * z, -2.0 * _3E * y * z, _3E * (xx - yy)),
        *(-3.0 * _3A * (xx - yy), 6.0 * _3A * x * y, 0.0 * x),
    )


def degree_of(terms: int) -> int:
    """Return the degree with this number of harmonics besides the constant one.

    Raises:
        ValueError: No degree from 0 to 3 has this number of harmonics.
    """
    if terms not in TERMS:
        raise ValueError(f"{terms} harmonics belong to no degree: there are {', '.join(map(str, TERMS))} of degree 0 to 3")
    return TERMS.index(terms)


def basis(x: Any, y: Any, z: Any, degree: int) -> tuple[Any, ...]:
    """Return the values of all functions of degree 1 to `degree`. Compiled kernels cannot call this function.

    Args:
        x, y, z: Components of unit vectors: numbers, arrays or tensors.
        degree: Highest degree, 0 to 3.
    """
    values: tuple[Any, ...] = ()
    for function in (first, second, third)[:degree]:
        values += function(x, y, z)
    return values


@cache
def _probes() -> Array:
    """Return directions spread evenly over the sphere, enough to determine all coefficients. [32, 3]."""
    count = 32
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


@cache
def _from_probes(degree: int) -> Array:
    """Return the matrix that maps a function's values at the probes to its coefficients. [K, 32]."""
    x, y, z = _probes().T
    return np.asarray(np.linalg.pinv(np.stack(basis(x, y, z, degree), axis=1)))


def turned(harmonics: Array, rotation: Array) -> Array:
    """Return the harmonics of turned splats.

    A rotation maps the functions of one degree to each other, so values at the probes determine the turned function exactly.

    Args:
        harmonics: Coefficients of the colours. [N, K, 3].
        rotation: `new_from_old`, one for all splats [3, 3] or one for each [N, 3, 3].

    Returns:
        Coefficients in the new frame, float32. [N, K, 3].
    """
    degree = degree_of(harmonics.shape[1])
    if degree == 0:
        return harmonics
    # The value of the turned function at d is that of the old function at R^T d.
    x, y, z = np.moveaxis(_probes() @ np.asarray(rotation, dtype=np.float64), -1, 0)
    values = np.stack(basis(x, y, z, degree), axis=-1)
    return np.asarray((_from_probes(degree) @ values) @ harmonics, dtype=np.float32)
