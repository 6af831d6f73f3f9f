"""Vectors of float32 inside kernels, for stencils that LLVM does not vectorise well by itself.

A vector has 16 lanes, which fill one AVX-512 register; LLVM splits them for other processors. ``+ - * /`` work
lane by lane and are rounded each, so that every processor gives the same numbers. The functions only exist inside
kernels. `load` and `store` check no bounds.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 16

_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_NOTHING = ir.Constant(_FLOATS, ir.Undefined)


class FloatVector(types.Type):
    """The type of `LANES` float32 numbers."""

    def __init__(self) -> None:
        super().__init__(name=f"FloatVector({LANES})")


float_vector = FloatVector()


@register_model(FloatVector)
class _FloatVectorModel(models.PrimitiveModel):
    """How LLVM holds a vector."""

    def __init__(self, manager: Any, vector: FloatVector) -> None:
        super().__init__(manager, vector, _FLOATS)


def _add_operator(function: Any, instruction: str) -> None:
    """Let ``function(vector, vector)`` in kernels be one LLVM instruction."""

    class VectorOperator(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if not kws and args == (float_vector, float_vector):
                return signature(float_vector, *args)
            return None

    cast(Any, infer_global)(function)(VectorOperator)

    @lower_builtin(function, float_vector, float_vector)
    def code(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments)


for _function, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _add_operator(_function, _instruction)


def _lane_function(implementation: Callable[..., Any]) -> Callable[..., Any]:
    """Make a function for kernels of one that gets the types of the arguments and returns type and code."""
    return intrinsic(implementation)


@_lane_function
def pointer(typing_context, array, index):
    """Return the address of an element of a contiguous array.

    Unlike arrays, addresses have no reference counts to keep, and pass from function to function for nothing.
    The array must be held by the caller of the kernel.
    """

    def code(context, builder, signature, arguments):
        data = context.make_array(array)(context, builder, arguments[0]).data
        return builder.gep(data, [arguments[1]])

    return types.CPointer(array.dtype)(array, types.intp), code


@_lane_function
def load(typing_context, address, index):
    """Return the 16 float32 from ``address[index]`` on."""

    def code(context, builder, signature, arguments):
        return builder.load(_place(builder, *arguments), align=4)

    return float_vector(types.CPointer(types.float32), types.intp), code


@_lane_function
def load_bytes(typing_context, address, index):
    """Return the 16 uint8 from ``address[index]`` on."""

    def code(context, builder, signature, arguments):
        place = builder.gep(arguments[0], [arguments[1]])
        lanes = ir.VectorType(ir.IntType(8), LANES)
        return builder.uitofp(builder.load(builder.bitcast(place, lanes.as_pointer()), align=1), _FLOATS)

    return float_vector(types.CPointer(types.uint8), types.intp), code


@_lane_function
def where_labelled(typing_context, labels, index, label, vector):
    """Return the vector where the 16 int32 from ``labels[index]`` on are the label, else 0."""
    integers = ir.VectorType(ir.IntType(32), LANES)
    zeros = ir.Constant(integers, [0] * LANES)

    def code(context, builder, signature, arguments):
        address, index, label, vector = arguments
        place = builder.bitcast(builder.gep(address, [index]), integers.as_pointer())
        single = builder.insert_element(ir.Constant(integers, ir.Undefined), label, ir.IntType(32)(0))
        every = builder.shuffle_vector(single, ir.Constant(integers, ir.Undefined), zeros)
        same = builder.icmp_signed("==", builder.load(place, align=4), every)
        return builder.select(same, vector, ir.Constant(_FLOATS, [0.0] * LANES))

    return float_vector(types.CPointer(types.int32), types.intp, types.int32, float_vector), code


@_lane_function
def store(typing_context, address, index, vector):
    """Set the 16 float32 from ``address[index]`` on."""

    def code(context, builder, signature, arguments):
        builder.store(arguments[2], _place(builder, *arguments[:2]), align=4)
        return context.get_dummy_value()

    return types.void(types.CPointer(types.float32), types.intp, float_vector), code


def _place(builder: Any, address: Any, index: Any) -> Any:
    """Return the address of the vector that begins at ``address[index]``."""
    return builder.bitcast(builder.gep(address, [index]), _FLOATS.as_pointer())


@_lane_function
def splat(typing_context, number):
    """Return a float32 in every lane."""
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

    def code(context, builder, signature, arguments):
        single = builder.insert_element(_NOTHING, arguments[0], ir.IntType(32)(0))
        return builder.shuffle_vector(single, _NOTHING, zeros)

    return float_vector(types.float32), code


def _shuffle(lanes: list[int]) -> Callable[..., Any]:
    """Return a function of two vectors that picks these lanes of the two, one behind the other."""
    picked = ir.Constant(ir.VectorType(ir.IntType(32), LANES), lanes)

    @_lane_function
    def shuffle(typing_context, a, b):
        def code(context, builder, signature, arguments):
            return builder.shuffle_vector(*arguments, picked)

        return float_vector(float_vector, float_vector), code

    return shuffle


even_lanes = _shuffle(list(range(0, 2 * LANES, 2)))
odd_lanes = _shuffle(list(range(1, 2 * LANES, 2)))
first_zipped = _shuffle([lane // 2 + lane % 2 * LANES for lane in range(LANES)])
last_zipped = _shuffle([lane // 2 + lane % 2 * LANES for lane in range(LANES, 2 * LANES)])


@_lane_function
def larger(typing_context, a, b):
    """Return a where a > b, else b."""

    def code(context, builder, signature, arguments):
        a, b = arguments
        return builder.select(builder.fcmp_ordered(">", a, b), a, b)

    return float_vector(float_vector, float_vector), code


@_lane_function
def where_positive(typing_context, condition, a, b):
    """Return a where the condition is > 0, else b."""

    def code(context, builder, signature, arguments):
        condition, a, b = arguments
        positive = builder.fcmp_ordered(">", condition, ir.Constant(_FLOATS, [0.0] * LANES))
        return builder.select(positive, a, b)

    return float_vector(float_vector, float_vector, float_vector), code


@_lane_function
def any_positive(typing_context, vector):
    """Return whether a lane is > 0."""

    def code(context, builder, signature, arguments):
        positive = builder.fcmp_ordered(">", arguments[0], ir.Constant(_FLOATS, [0.0] * LANES))
        word = builder.bitcast(positive, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", word, ir.IntType(LANES)(0))

    return types.boolean(float_vector), code


@_lane_function
def total(typing_context, vector):
    """Return the sum of the lanes in float64, in their order."""

    def code(context, builder, signature, arguments):
        wide = builder.fpext(arguments[0], ir.VectorType(ir.DoubleType(), LANES))
        result = builder.extract_element(wide, ir.IntType(32)(0))
        for lane in range(1, LANES):
            result = builder.fadd(result, builder.extract_element(wide, ir.IntType(32)(lane)))
        return result

    return types.float64(float_vector), code


@_lane_function
def largest(typing_context, vector):
    """Return the largest lane."""

    def code(context, builder, signature, arguments):
        name = f"llvm.vector.reduce.fmax.v{LANES}f32"
        function_type = ir.FunctionType(ir.FloatType(), [_FLOATS])
        return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), arguments)

    return types.float32(float_vector), code
