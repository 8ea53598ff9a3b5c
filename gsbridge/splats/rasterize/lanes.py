"""A SIMD type for numba: eight float32 values that a kernel handles as one.

numba leaves vectorisation to LLVM, which silently gives up on loops with masks and reductions. Here a kernel vectorises
explicitly: `Lanes` lowers to LLVM's `<8 x float>`, which becomes one AVX register (or two of SSE or NEON), so the same source
runs on every processor. Arithmetic works between lanes, and between lanes and a number. Comparisons give a `Mask` for
`select`. `WideLanes` have sixteen values: one register with AVX-512 (`HAS_WIDE`), two elsewhere. Fewer functions accept them.

Multiplications and additions may be fused (one rounding instead of two), and the sign of a zero may be lost. Nothing else is
relaxed, so comparisons with NaN are false.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, TypeAlias

from llvmlite import ir

from gsbridge.kernels import intrinsic, options

import llvmlite.binding as llvm  # isort: skip
from numba.core import types  # isort: skip  (numba must be imported after gsbridge.kernels has set its cache folder)
from numba.core.typing.templates import AbstractTemplate, infer_global, signature  # isort: skip
from numba.extending import lower_builtin, models, register_model  # isort: skip

WIDTH = 8
WIDE = 16
FLAGS = ("contract", "nsz")
FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
WIDE_FLOATS = ir.VectorType(ir.FloatType(), WIDE)
INTS = ir.VectorType(ir.IntType(32), WIDTH)


def _has_wide() -> bool:
    """Whether numba compiles for a processor with registers of sixteen float32."""
    if not options.ENABLE_AVX:
        return False
    if options.CPU_FEATURES is None:
        return bool(llvm.get_host_cpu_features().get("avx512f", False))
    return "+avx512f" in options.CPU_FEATURES.split(",")


HAS_WIDE = _has_wide()


class _LanesType(types.Type):
    def __init__(self, name: str, width: int) -> None:
        self.width = width
        super().__init__(name=name)


class _MaskType(types.Type):
    def __init__(self, name: str, width: int) -> None:
        self.width = width
        super().__init__(name=name)


Lanes, WideLanes = _LanesType("Lanes", WIDTH), _LanesType("WideLanes", WIDE)
Mask, WideMask = _MaskType("Mask", WIDTH), _MaskType("WideMask", WIDE)
_MASKS = {Lanes: Mask, WideLanes: WideMask}
LaneValues: TypeAlias = Any
"""Type of values in `Lanes`, `WideLanes` or a mask: Python's type checkers do not know numba's types."""


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.FloatType(), kind.width))


@register_model(_MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


def spread_scalar(builder: ir.IRBuilder, value: ir.Value, width: int = WIDTH) -> ir.Value:
    """Emit the copy of a scalar to all lanes.

    Args:
        builder: Builder that receives the instructions.
        value: A float32.
        width: Number of lanes.
    """
    undefined = ir.Constant(ir.VectorType(ir.FloatType(), width), ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width))


def _as_lanes(context: Any, builder: ir.IRBuilder, value: ir.Value, kind: types.Type, width: int) -> ir.Value:
    if isinstance(kind, _LanesType):
        return value
    return spread_scalar(builder, context.cast(builder, value, kind, types.float32), width)


def _common(kinds: Any) -> Any:
    """Return the lane type among some types; None if there is none, if there are two, or if another type is not a number."""
    lanes = {kind for kind in kinds if isinstance(kind, _LanesType)}
    fits = len(lanes) == 1 and all(isinstance(kind, _LanesType | types.Number) for kind in kinds)
    return lanes.pop() if fits else None


def _binary(function: Callable[..., Any], emit: Callable[..., ir.Value], *, compares: bool = False) -> None:
    """Register an operator with numba, between lanes or between lanes and a number."""

    @infer_global(function)
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            lanes = _common(args) if len(args) == 2 else None
            return None if lanes is None else signature(_MASKS[lanes] if compares else lanes, *args)

    for pair in ((_LanesType, _LanesType), (_LanesType, types.Number), (types.Number, _LanesType)):

        @lower_builtin(function, *pair)
        def _lower(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            width = _common(sig.args).width
            return emit(
                builder, *(_as_lanes(context, builder, value, kind, width) for value, kind in zip(args, sig.args, strict=True))
            )


_binary(operator.add, lambda b, x, y: b.fadd(x, y, flags=FLAGS))
_binary(operator.sub, lambda b, x, y: b.fsub(x, y, flags=FLAGS))
_binary(operator.mul, lambda b, x, y: b.fmul(x, y, flags=FLAGS))
_binary(operator.truediv, lambda b, x, y: b.fdiv(x, y, flags=FLAGS))
_binary(operator.lt, lambda b, x, y: b.fcmp_ordered("<", x, y), compares=True)
_binary(operator.le, lambda b, x, y: b.fcmp_ordered("<=", x, y), compares=True)
_binary(operator.gt, lambda b, x, y: b.fcmp_ordered(">", x, y), compares=True)
_binary(operator.ge, lambda b, x, y: b.fcmp_ordered(">=", x, y), compares=True)


def _logical(function: Callable[..., Any], emit: Callable[..., ir.Value]) -> None:
    """Register an operator between masks with numba."""

    @infer_global(function)
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: dict[str, Any]) -> Any:
            fits = len(args) == 2 and isinstance(args[0], _MaskType) and args[0] == args[1]
            return signature(args[0], *args) if fits else None

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
    """Emit a call of an LLVM intrinsic.

    Args:
        builder: Builder that receives the call.
        name: LLVM's name of the intrinsic, with its overloaded types.
        result: Type of the result.
        args: Arguments of the call.
    """
    kind = ir.FunctionType(result, [value.type for value in args])
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, args)


@intrinsic
def spread(typing: Any, value: Any) -> Any:
    """Return lanes that all hold the same number."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return spread_scalar(builder, context.cast(builder, args[0], sig.args[0], types.float32))

    return Lanes(value), generate


@intrinsic
def spread_wide(typing: Any, value: Any) -> Any:
    """Return wide lanes that all hold the same number."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return spread_scalar(builder, context.cast(builder, args[0], sig.args[0], types.float32), WIDE)

    return WideLanes(value), generate


@intrinsic
def select(typing: Any, mask: Any, chosen: Any, other: Any) -> Any:
    """Return, lane by lane, `chosen` where the mask is set and `other` elsewhere.

    Args:
        mask: A `Mask` or `WideMask`.
        chosen, other: Lanes of the mask's width, or numbers.
    """
    if not isinstance(mask, _MaskType):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        values = zip(args[1:], sig.args[1:], strict=True)
        left, right = (_as_lanes(context, builder, value, kind, mask.width) for value, kind in values)
        return builder.select(args[0], left, right)

    return (Lanes if mask == Mask else WideLanes)(mask, chosen, other), generate


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


def _extreme(operator_name: str, doc: str) -> Any:
    @intrinsic
    def function(typing: Any, left: Any, right: Any) -> Any:
        lanes = _common((left, right))

        def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
            x, y = (_as_lanes(context, builder, value, kind, lanes.width) for value, kind in zip(args, sig.args, strict=True))
            return builder.select(builder.fcmp_ordered(operator_name, x, y), x, y)

        return None if lanes is None else (lanes(left, right), generate)

    function.__doc__ = doc
    return function


smaller = _extreme("<", "Smaller of two, lane by lane; `right` where either is NaN. Numbers may stand for lanes.")
larger = _extreme(">", "Larger of two, lane by lane; `right` where either is NaN. Numbers may stand for lanes.")


@intrinsic
def mask_bits(typing: Any, mask: Any) -> Any:
    """Return the mask as an integer, with lane 0 in the lowest bit."""
    if not isinstance(mask, _MaskType):
        return None

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return builder.zext(builder.bitcast(args[0], ir.IntType(mask.width)), ir.IntType(64))

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
        # Subtracting the bits of 2/3 makes the exponent change at mantissa 4/3 instead of 2.
        shifted = builder.sub(bits, constant(0x3F2AAAAB))
        exponent = builder.ashr(shifted, constant(23))
        mantissa = builder.bitcast(builder.sub(bits, builder.shl(exponent, constant(23))), FLOATS)
        return context.make_tuple(builder, sig.return_type, [builder.sitofp(exponent, FLOATS), mantissa])

    return types.UniTuple(Lanes, 2)(value), generate


@intrinsic
def sums_of_eight(typing: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any) -> Any:
    """Return the sum over the lanes of each of eight arguments, as eight lanes: a transposition combined with additions.

    Args:
        a, b, c, d, e, f, g, h: `Lanes` each; the sum over the k-th argument becomes lane k.
    """

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        def pair(x: ir.Value, y: ir.Value, low: list[int], high: list[int]) -> ir.Value:
            first = builder.shuffle_vector(x, y, ir.Constant(INTS, low))
            return builder.fadd(first, builder.shuffle_vector(x, y, ir.Constant(INTS, high)), flags=FLAGS)

        # Add within each half of four lanes first, then across the halves: shuffles within a half are cheaper.
        even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
        twos = [pair(args[k], args[k + 1], even, odd) for k in (0, 2, 4, 6)]
        low, high = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        fours = [pair(twos[k], twos[k + 1], low, high) for k in (0, 2)]
        return pair(fours[0], fours[1], [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])

    kinds = (a, b, c, d, e, f, g, h)
    return (Lanes(*kinds), generate) if all(kind == Lanes for kind in kinds) else None


@intrinsic
def bits_between(typing: Any, first: Any, last: Any) -> Any:
    """Return an integer with the bits from `first` up to, but without, `last` set; 0 if there are none.

    Args:
        first, last: `Lanes` with bit numbers, truncated to integers, which must be 0..15.
    """

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        low, high = (builder.fptosi(value, INTS) for value in args)
        high = builder.select(builder.icmp_signed("<", high, low), low, high)
        one = ir.Constant(INTS, [1] * WIDTH)
        return builder.sitofp(builder.sub(builder.shl(one, high), builder.shl(one, low)), FLOATS)

    return (Lanes(first, last), generate) if (first, last) == (Lanes, Lanes) else None


@intrinsic
def lowest_bit(typing: Any, bits: Any) -> Any:
    """Return the index of the lowest set bit of an int64 that is not zero."""

    def generate(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> ir.Value:
        return call_llvm(builder, "llvm.cttz.i64", ir.IntType(64), [args[0], ir.Constant(ir.IntType(1), 1)])

    return types.int64(types.int64), generate
