"""Vectors of small integers inside kernels, for loops that LLVM does not vectorise well by itself.

A vector has 32 lanes of unsigned integers; 32 of uint8 fill an AVX2 register, and LLVM splits or joins them for
what the processor has. The functions only exist inside kernels. Lanes wrap around like uint8 and uint16 do. `load`
and `store` check no bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 32


class Vector(types.Type):
    """The type of `LANES` unsigned integers of so many bits; of 1 bit for the outcome of a comparison."""

    def __init__(self, bits: int) -> None:
        self.bits = bits
        super().__init__(name=f"Vector({LANES} x {bits} bits)")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    """How LLVM holds a vector."""

    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(manager, vector, _ir_vector(vector.bits))


def _lane_function(implementation: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function for kernels of one that gets the types of the arguments and returns type and code."""
    return intrinsic(implementation)


def _ir_vector(bits: int) -> ir.VectorType:
    return ir.VectorType(ir.IntType(bits), LANES)


def _call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    """Call a function of LLVM's."""
    function_type = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), arguments)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    """Return the address of the vector that begins at an element of an array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _ir_vector(array_type.dtype.bitwidth).as_pointer())


@_lane_function
def load(typing_context, array, index):
    """Return elements index, index + 1, ... of a contiguous array of unsigned integers."""
    bits = array.dtype.bitwidth

    def code(context, builder, signature, arguments):
        return builder.load(_address(context, builder, array, *arguments), align=bits // 8)

    return Vector(bits)(array, types.intp), code


@_lane_function
def store(typing_context, array, index, vector):
    """Set elements index, index + 1, ... of a contiguous array of unsigned integers."""
    bits = array.dtype.bitwidth

    def code(context, builder, signature, arguments):
        builder.store(arguments[2], _address(context, builder, array, *arguments[:2]), align=bits // 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, Vector(bits)), code


@_lane_function
def splat(typing_context, scalar):
    """Return an unsigned integer in every lane."""
    vector = _ir_vector(scalar.bitwidth)
    undefined = ir.Constant(vector, ir.Undefined)
    zeros = ir.Constant(_ir_vector(32), [0] * LANES)

    def code(context, builder, signature, arguments):
        single = builder.insert_element(undefined, arguments[0], ir.IntType(32)(0))
        return builder.shuffle_vector(single, undefined, zeros)

    return Vector(scalar.bitwidth)(scalar), code


@_lane_function
def lane_numbers(typing_context):
    """Return 0, 1, 2, ... as uint16."""

    def code(context, builder, signature, arguments):
        return ir.Constant(_ir_vector(16), list(range(LANES)))

    return Vector(16)(), code


def _lanewise(build: Callable[[Any, Any, Any], Any]) -> Callable[..., Any]:
    """Return a function of two vectors of the same type; `build` writes its code."""

    @_lane_function
    def operation(typing_context, a, b):
        def code(context, builder, signature, arguments):
            return build(builder, *arguments)

        return a(a, a), code

    return operation


add = _lanewise(lambda builder, a, b: builder.add(a, b))
subtract = _lanewise(lambda builder, a, b: builder.sub(a, b))
multiply = _lanewise(lambda builder, a, b: builder.mul(a, b))
bit_and = _lanewise(lambda builder, a, b: builder.and_(a, b))
bit_or = _lanewise(lambda builder, a, b: builder.or_(a, b))
bit_xor = _lanewise(lambda builder, a, b: builder.xor(a, b))
shift_left = _lanewise(lambda builder, a, b: builder.shl(a, b))
shift_right = _lanewise(lambda builder, a, b: builder.lshr(a, b))
minimum = _lanewise(lambda builder, a, b: builder.select(builder.icmp_unsigned("<", a, b), a, b))
add_saturating = _lanewise(  # the largest number instead of a wrap-around
    lambda builder, a, b: _call(builder, f"llvm.uadd.sat.v{LANES}i{a.type.element.width}", a.type, a, b)
)


@_lane_function
def less(typing_context, a, b):
    """Return the condition a < b of every lane."""

    def code(context, builder, signature, arguments):
        return builder.icmp_unsigned("<", *arguments)

    return Vector(1)(a, a), code


@_lane_function
def choose(typing_context, condition, a, b):
    """Return the lanes of a where the condition holds, those of b elsewhere."""

    def code(context, builder, signature, arguments):
        return builder.select(*arguments)

    return a(Vector(1), a, a), code


@_lane_function
def first_lane(typing_context, condition):
    """Return the number of the first lane where the condition holds, `LANES` if there is none."""

    def code(context, builder, signature, arguments):
        word = builder.bitcast(arguments[0], ir.IntType(LANES))
        zeros = _call(builder, f"llvm.cttz.i{LANES}", word.type, word, ir.IntType(1)(0))
        return builder.zext(zeros, context.get_value_type(types.intp))

    return types.intp(Vector(1)), code


@_lane_function
def widen(typing_context, vector):
    """Return uint8 lanes as uint16."""

    def code(context, builder, signature, arguments):
        return builder.zext(arguments[0], _ir_vector(16))

    return Vector(16)(Vector(8)), code


@_lane_function
def narrow(typing_context, vector):
    """Return the low 8 bits of every lane."""

    def code(context, builder, signature, arguments):
        return builder.trunc(arguments[0], _ir_vector(8))

    return Vector(8)(vector), code


@_lane_function
def count_bits(typing_context, vector):
    """Return the number of bits that are set in every lane."""

    def code(context, builder, signature, arguments):
        return _call(builder, f"llvm.ctpop.v{LANES}i{vector.bits}", _ir_vector(vector.bits), *arguments)

    return vector(vector), code


@_lane_function
def smallest(typing_context, vector):
    """Return the smallest lane."""

    def code(context, builder, signature, arguments):
        name = f"llvm.vector.reduce.umin.v{LANES}i{vector.bits}"
        return _call(builder, name, ir.IntType(vector.bits), *arguments)

    return types.Integer.from_bitwidth(vector.bits, signed=False)(vector), code
