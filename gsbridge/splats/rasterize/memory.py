"""Loads, stores and transpositions between lanes and flat arrays, without numba's extra code for negative indices."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from gsbridge.kernels import intrinsic

from numba.core import types  # isort: skip  (numba must be imported after gsbridge.kernels has set its cache folder)

from gsbridge.splats.rasterize.lanes import FLOATS, INTS, WIDE_FLOATS, WIDTH, Lanes, WideLanes, call_llvm, spread_scalar

_HALF = WIDTH // 2
_FOUR = ir.VectorType(ir.FloatType(), _HALF)
_TWELVE = ir.VectorType(ir.FloatType(), 3 * _HALF)


def _address(context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value, index: ir.Value) -> ir.Value:
    """Emit the address of an element of a flat, contiguous array."""
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [index])


def _is_flat(kind: Any, dtype: Any) -> bool:
    return isinstance(kind, types.Array) and kind.ndim == 1 and kind.layout == "C" and kind.dtype == dtype


@intrinsic
def at(typing: Any, array: Any, index: Any) -> Any:
    """Return an element of a flat array, without numba's extra code for negative indices."""
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return builder.load(_address(context, builder, sig.args[0], args[0], args[1]))

    return array.dtype(array, types.intp), generate


@intrinsic
def put(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write an element of a flat array, without numba's extra code for negative indices.

    Args:
        array: Flat array, C order, of any type.
        index: Index of the element.
        value: A number of the array's type.
    """
    if not (isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        builder.store(args[2], _address(context, builder, sig.args[0], args[0], args[1]))
        return context.get_dummy_value()

    return types.void(array, types.intp, array.dtype), generate


def _load(kind: Any, vector: ir.VectorType, doc: str) -> Any:
    @intrinsic
    def function(typing: Any, array: Any, index: Any) -> Any:
        def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            address = _address(context, builder, sig.args[0], args[0], args[1])
            return builder.load(builder.bitcast(address, vector.as_pointer()), align=4)

        return (kind(array, types.intp), generate) if _is_flat(array, types.float32) else None

    function.__doc__ = doc
    return function


load = _load(Lanes, FLOATS, "Lanes from a flat float32 array, from `index` on.")
load_wide = _load(WideLanes, WIDE_FLOATS, "Wide lanes from a flat float32 array, from `index` on.")


@intrinsic
def load_spread(typing: Any, array: Any, index: Any) -> Any:
    """Return lanes that all hold one element of a flat float32 array."""
    if not _is_flat(array, types.float32):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return spread_scalar(builder, builder.load(_address(context, builder, sig.args[0], args[0], args[1])))

    return Lanes(array, types.intp), generate


def _interleaved(columns: int, doc: str) -> Any:
    @intrinsic
    def function(typing: Any, array: Any, index: Any) -> Any:
        def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            wide = ir.VectorType(ir.FloatType(), WIDTH * columns)
            address = _address(context, builder, sig.args[0], args[0], args[1])
            rows = builder.load(builder.bitcast(address, wide.as_pointer()), align=4)
            undefined = ir.Constant(wide, ir.Undefined)
            picks = [ir.Constant(INTS, [k + columns * lane for lane in range(WIDTH)]) for k in range(columns)]
            return context.make_tuple(
                builder, sig.return_type, [builder.shuffle_vector(rows, undefined, pick) for pick in picks]
            )

        return (types.UniTuple(Lanes, columns)(array, types.intp), generate) if _is_flat(array, types.float32) else None

    function.__doc__ = doc
    return function


load_triples = _interleaved(3, "The three columns of eight rows of a flat [N, 3] float32 array, from an element's `index` on.")
load_quads = _interleaved(4, "The four columns of eight rows of a flat [N, 4] float32 array, from an element's `index` on.")


@intrinsic
def store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write lanes, wide or not, into a flat float32 array, from `index` on.

    Args:
        array: Flat float32 array.
        index: Index at which the first lane is written.
        value: `Lanes` or `WideLanes`.
    """
    if not _is_flat(array, types.float32) or value not in (Lanes, WideLanes):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        address = _address(context, builder, sig.args[0], args[0], args[1])
        builder.store(args[2], builder.bitcast(address, args[2].type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


@intrinsic
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Prefetch the cache line of an element that will be read soon."""
    if not _is_flat(array, types.float32):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        address = builder.bitcast(_address(context, builder, sig.args[0], args[0], args[1]), ir.IntType(8).as_pointer())
        flags = [ir.Constant(ir.IntType(32), number) for number in (0, 3, 1)]  # read, keep in all levels, data
        call_llvm(builder, "llvm.prefetch.p0", ir.VoidType(), [address, *flags])
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


@intrinsic
def store_rows(
    typing: Any, array: Any, index: Any, stride: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any
) -> Any:
    """Write the k-th lanes of eight arguments side by side at `index + k * stride`: a transposition.

    Args:
        array: Flat float32 array.
        index: Index at which the first row begins.
        stride: Number of elements from one row to the next.
        a, b, c, d, e, f, g, h: `Lanes` each; row k gets their k-th lanes in this order.
    """
    columns = (a, b, c, d, e, f, g, h)
    if not _is_flat(array, types.float32) or any(kind != Lanes for kind in columns):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        def pick(x: ir.Value, y: ir.Value, lanes: list[int]) -> ir.Value:
            return builder.shuffle_vector(x, y, ir.Constant(INTS, lanes))

        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        position, step, *values = args[1:]
        low, high = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
        twos = [pick(values[k], values[k + 1], lanes) for k in (0, 2, 4, 6) for lanes in (low, high)]
        low, high = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        fours = [pick(twos[k + half], twos[k + 2 + half], lanes) for k in (0, 4) for half in (0, 1) for lanes in (low, high)]
        low, high = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        for lanes in (low, high):
            for k in range(4):
                address = builder.bitcast(builder.gep(data, [position]), FLOATS.as_pointer())
                builder.store(pick(fours[k], fours[k + 4], lanes), address, align=4)
                position = builder.add(position, step)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, *columns), generate


@intrinsic
def store_whole(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write lanes, truncated to integers, into a flat int32 array, from `index` on.

    Args:
        array: Flat int32 array.
        index: Index at which the first lane is written.
        value: `Lanes`.
    """
    if not _is_flat(array, types.int32) or value != Lanes:
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        address = _address(context, builder, sig.args[0], args[0], args[1])
        builder.store(builder.fptosi(args[2], INTS), builder.bitcast(address, INTS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, Lanes), generate


def _pick(builder: ir.IRBuilder, left: ir.Value, right: ir.Value | None, lanes: list[int]) -> ir.Value:
    """Emit a vector of chosen elements of one or two vectors; the second one's elements are numbered after the first one's."""
    other = ir.Constant(left.type, ir.Undefined) if right is None else right
    return builder.shuffle_vector(left, other, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes))


@intrinsic
def load_halves(typing: Any, array: Any, index: Any, stride: Any) -> Any:
    """Load four elements from `index` on, then four from `index + stride` on: two rows of pixels.

    Args:
        array: Flat float32 array.
        index: Index of the first four elements.
        stride: Number of elements from there to the other four.
    """
    if not _is_flat(array, types.float32):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        halves: list[ir.Value] = []
        for position in (args[1], builder.add(args[1], args[2])):
            address = _address(context, builder, sig.args[0], args[0], position)
            halves.append(builder.load(builder.bitcast(address, _FOUR.as_pointer()), align=4))
        return _pick(builder, halves[0], halves[1], list(range(WIDTH)))

    return Lanes(array, types.intp, types.intp), generate


@intrinsic
def store_halves(typing: Any, array: Any, index: Any, stride: Any, value: Any) -> Any:
    """Write four lanes from `index` on and the other four from `index + stride` on: the inverse of `load_halves`.

    Args:
        array: Flat float32 array.
        index: Index at which the first four lanes are written.
        stride: Number of elements from there to the other four.
        value: `Lanes`.
    """
    if not _is_flat(array, types.float32) or value != Lanes:
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        for first, position in ((0, args[1]), (_HALF, builder.add(args[1], args[2]))):
            address = _address(context, builder, sig.args[0], args[0], position)
            half = _pick(builder, args[3], None, list(range(first, first + _HALF)))
            builder.store(half, builder.bitcast(address, _FOUR.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, Lanes), generate


@intrinsic
def load_pixels(typing: Any, array: Any, index: Any, stride: Any) -> Any:
    """Load red, green and blue of four pixels from `index` on and of four from `index + stride` on.

    Args:
        array: Flat float32 array of RGB pixels.
        index: Index of the first pixel's red.
        stride: Number of elements from there to the fifth pixel's red.

    Returns:
        Red, green and blue, `Lanes` each.
    """
    if not _is_flat(array, types.float32):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        rows: list[ir.Value] = []
        for position in (args[1], builder.add(args[1], args[2])):
            address = _address(context, builder, sig.args[0], args[0], position)
            rows.append(builder.load(builder.bitcast(address, _TWELVE.as_pointer()), align=4))
        colours = [_pick(builder, rows[0], rows[1], [colour + 3 * pixel for pixel in range(WIDTH)]) for colour in range(3)]
        return context.make_tuple(builder, sig.return_type, colours)

    return types.UniTuple(Lanes, 3)(array, types.intp, types.intp), generate


@intrinsic
def store_pixels(typing: Any, array: Any, index: Any, stride: Any, red: Any, green: Any, blue: Any) -> Any:
    """Write red, green and blue of eight pixels, four of them in each of two rows: the inverse of `load_pixels`.

    Args:
        array: Flat float32 array of RGB pixels.
        index: Index of the first pixel's red.
        stride: Number of elements from there to the fifth pixel's red.
        red, green, blue: `Lanes` each.
    """
    if not _is_flat(array, types.float32) or any(kind != Lanes for kind in (red, green, blue)):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        both = _pick(builder, args[3], args[4], list(range(2 * WIDTH)))
        last = _pick(builder, args[5], None, [*range(WIDTH)] * 2)
        for first, position in ((0, args[1]), (_HALF, builder.add(args[1], args[2]))):
            # In `both` followed by `last`, a pixel's green is 8 elements after its red, and its blue 16.
            order = [first + pixel + WIDTH * colour for pixel in range(_HALF) for colour in range(3)]
            address = _address(context, builder, sig.args[0], args[0], position)
            builder.store(_pick(builder, both, last, order), builder.bitcast(address, _TWELVE.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, Lanes, Lanes, Lanes), generate
