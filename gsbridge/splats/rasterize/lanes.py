"""Eight float32 values that a kernel handles as one: a SIMD type for numba.

numba leaves vectorisation to LLVM, which gives up silently on loops with masks and reductions. Here a kernel says what it
wants: `Lanes` lowers to LLVM's `<8 x float>`, which becomes one AVX register (or two of SSE or NEON), so the same source runs
on every processor. Arithmetic works between lanes and between lanes and a float32. Comparisons give a `Mask` for `select`.

Multiplications and additions may fuse (one rounding instead of two); nothing else is relaxed, so NaN compares false.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir

from gsbridge.kernels import njit  # noqa: F401  (also marks this module as kernel source, see gsbridge.kernels)

from numba.core import types  # isort: skip  (numba must be imported after gsbridge.kernels has set its cache folder)
from numba.core.typing.templates import AbstractTemplate, infer_global, signature  # isort: skip
from numba.extending import intrinsic, lower_builtin, models, register_model  # isort: skip

WIDTH = 8
FLAGS = ("contract", "nsz")
FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
INTS = ir.VectorType(ir.IntType(32), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Lanes")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Mask")


Lanes = _LanesType()
Mask = _MaskType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, FLOATS)


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


def spread_scalar(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    """A scalar copied to all lanes."""
    zero = ir.Constant(ir.IntType(32), 0)
    one = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), value, zero)
    return builder.shuffle_vector(one, ir.Constant(FLOATS, ir.Undefined), ir.Constant(INTS, [0] * WIDTH))


def _as_lanes(context: Any, builder: ir.IRBuilder, value: ir.Value, kind: types.Type) -> ir.Value:
    if isinstance(kind, _LanesType):
        return value
    return spread_scalar(builder, context.cast(builder, value, kind, types.float32))


def _binary(function: Callable[..., Any], emit: Callable[..., ir.Value], result: types.Type) -> None:
    """Teach numba an operator between lanes, or between lanes and a number."""

    @infer_global(function)
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            fits = len(args) == 2 and all(isinstance(kind, _LanesType | types.Number) for kind in args)
            return signature(result, *args) if fits and Lanes in args else None

    for pair in ((_LanesType, _LanesType), (_LanesType, types.Number), (types.Number, _LanesType)):

        @lower_builtin(function, *pair)
        def _lower(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            left, right = (_as_lanes(context, builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
            return emit(builder, left, right)


_binary(operator.add, lambda b, x, y: b.fadd(x, y, flags=FLAGS), Lanes)
_binary(operator.sub, lambda b, x, y: b.fsub(x, y, flags=FLAGS), Lanes)
_binary(operator.mul, lambda b, x, y: b.fmul(x, y, flags=FLAGS), Lanes)
_binary(operator.truediv, lambda b, x, y: b.fdiv(x, y, flags=FLAGS), Lanes)
_binary(operator.lt, lambda b, x, y: b.fcmp_ordered("<", x, y), Mask)
_binary(operator.le, lambda b, x, y: b.fcmp_ordered("<=", x, y), Mask)
_binary(operator.gt, lambda b, x, y: b.fcmp_ordered(">", x, y), Mask)
_binary(operator.ge, lambda b, x, y: b.fcmp_ordered(">=", x, y), Mask)


def _logical(function: Callable[..., Any], emit: Callable[..., ir.Value]) -> None:
    """Teach numba an operator between masks."""

    @infer_global(function)
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            return signature(Mask, Mask, Mask) if args == (Mask, Mask) else None

    @lower_builtin(function, _MaskType, _MaskType)
    def _lower(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return emit(builder, *args)


_logical(operator.and_, lambda b, x, y: b.and_(x, y))
_logical(operator.or_, lambda b, x, y: b.or_(x, y))


@infer_global(operator.neg)
class _NegTyping(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
        return signature(Lanes, Lanes) if args == (Lanes,) else None


@lower_builtin(operator.neg, _LanesType)
def _lower_neg(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
    return builder.fneg(args[0])


def call_llvm(builder: ir.IRBuilder, name: str, result: ir.Type, args: list[ir.Value]) -> ir.Value:
    """Call an LLVM intrinsic."""
    kind = ir.FunctionType(result, [value.type for value in args])
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, args)


@intrinsic
def spread(typing: Any, value: Any) -> Any:
    """A number in all lanes."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return spread_scalar(builder, context.cast(builder, args[0], sig.args[0], types.float32))

    return Lanes(value), generate


@intrinsic
def select(typing: Any, mask: Any, chosen: Any, other: Any) -> Any:
    """Lane by lane: `chosen` where the mask is set, `other` elsewhere. Both may be numbers."""
    if mask != Mask:
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        left, right = (_as_lanes(context, builder, value, kind) for value, kind in zip(args[1:], sig.args[1:], strict=True))
        return builder.select(args[0], left, right)

    return Lanes(mask, chosen, other), generate


def _unary(name: str, doc: str) -> Any:
    @intrinsic
    def function(typing: Any, value: Any) -> Any:
        def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            return call_llvm(builder, f"llvm.{name}.v{WIDTH}f32", FLOATS, [args[0]])

        return (Lanes(value), generate) if value == Lanes else None

    function.__doc__ = doc
    return function


square_root = _unary("sqrt", "Square root of every lane.")
round_down = _unary("floor", "Largest whole number not above each lane.")


@intrinsic
def smaller(typing: Any, left: Any, right: Any) -> Any:
    """Smaller of two, lane by lane; `right` where either is NaN. Numbers may stand for lanes."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        x, y = (_as_lanes(context, builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
        return builder.select(builder.fcmp_ordered("<", x, y), x, y)

    return Lanes(left, right), generate


@intrinsic
def larger(typing: Any, left: Any, right: Any) -> Any:
    """Larger of two, lane by lane; `right` where either is NaN. Numbers may stand for lanes."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        x, y = (_as_lanes(context, builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
        return builder.select(builder.fcmp_ordered(">", x, y), x, y)

    return Lanes(left, right), generate


@intrinsic
def mask_bits(typing: Any, mask: Any) -> Any:
    """The mask as a whole number, lane 0 in the lowest bit."""
    if mask != Mask:
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return builder.zext(builder.bitcast(args[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.int64(mask), generate


@intrinsic
def exponent_and_mantissa(typing: Any, value: Any) -> Any:
    """Split positive normal numbers into `mantissa * 2**exponent`, mantissa in [2/3, 4/3)."""
    if value != Lanes:
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        def constant(number: int) -> ir.Value:
            return ir.Constant(INTS, [number] * WIDTH)

        bits = builder.bitcast(args[0], INTS)
        # Subtracting the bits of 2/3 puts the change of exponent at mantissa 4/3 instead of 2.
        shifted = builder.sub(bits, constant(0x3F2AAAAB))
        exponent = builder.ashr(shifted, constant(23))
        mantissa = builder.bitcast(builder.sub(bits, builder.shl(exponent, constant(23))), FLOATS)
        return context.make_tuple(builder, sig.return_type, [builder.sitofp(exponent, FLOATS), mantissa])

    return types.UniTuple(Lanes, 2)(value), generate


@intrinsic
def sums_of_eight(typing: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any) -> Any:
    """Sum over the lanes of each of eight arguments, as eight lanes: a transposition with additions on the way."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        def pair(x: ir.Value, y: ir.Value, low: list[int], high: list[int]) -> ir.Value:
            first = builder.shuffle_vector(x, y, ir.Constant(INTS, low))
            return builder.fadd(first, builder.shuffle_vector(x, y, ir.Constant(INTS, high)), flags=FLAGS)

        # Within each half of four lanes, then across the halves, so that no early step leaves its half (cheap shuffles).
        even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
        twos = [pair(args[k], args[k + 1], even, odd) for k in (0, 2, 4, 6)]
        low, high = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        fours = [pair(twos[k], twos[k + 1], low, high) for k in (0, 2)]
        return pair(fours[0], fours[1], [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])

    kinds = (a, b, c, d, e, f, g, h)
    return (Lanes(*kinds), generate) if all(kind == Lanes for kind in kinds) else None


@intrinsic
def bits_between(typing: Any, first: Any, last: Any) -> Any:
    """The bits from `first` to before `last` as a whole number, both cut to whole numbers 0..15; 0 where there are none."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        low, high = (builder.fptosi(value, INTS) for value in args)
        high = builder.select(builder.icmp_signed("<", high, low), low, high)
        one = ir.Constant(INTS, [1] * WIDTH)
        return builder.sitofp(builder.sub(builder.shl(one, high), builder.shl(one, low)), FLOATS)

    return (Lanes(first, last), generate) if (first, last) == (Lanes, Lanes) else None


@intrinsic
def lowest_bit(typing: Any, bits: Any) -> Any:
    """Number of the lowest set bit of an int64 that is not zero."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return call_llvm(builder, "llvm.cttz.i64", ir.IntType(64), [args[0], ir.Constant(ir.IntType(1), 1)])

    return types.int64(types.int64), generate
