"""Restoration in the gradient domain with data terms and a lower bound: a fast screened Poisson solver."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import InputError, StereoHdrWarning
from stereohdr.float_vectors import LANES
from stereohdr.restoration import _screened_poisson_kernels as kernels
from stereohdr.strips import run_strips

STRIP_ROWS = 32
"""Rows of the image that are turned into equations at a time."""

TASK_ROWS = 16 * STRIP_ROWS
"""Rows that a thread turns into equations before it asks for more."""

MOST_ITERATIONS = 1000
"""Of conjugate gradients; ten to thirty are usual."""

MOST_ROUNDS = 100
"""Of finding the pixels at their bound and solving for the others; two to four are usual."""

MARGIN = 4 * LANES
"""Zeros after each array, for vectors that reach beyond it."""

ENOUGH = 0.2
"""Of the tolerance: how far pixels may be below their bound, or be pulled up from it."""


def solve_screened_poisson(
    domain: NDArray[np.bool_],
    fixed: NDArray[np.float32],
    *,
    data: NDArray[np.float32],
    data_weight: NDArray[np.float32],
    gradient_x: NDArray[np.float32],
    gradient_y: NDArray[np.float32],
    weight_x: NDArray[np.float32],
    weight_y: NDArray[np.float32],
    lower: NDArray[np.float32] | None = None,
    tolerance: float = 2e-4,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Find the image u that is near `data`, has nearly the given gradient, and is nowhere below `lower`.

    Minimises, over the pixels p of `domain`, the sum of ``data_weight[p] (u[p] - data[p])^2``, of
    ``weight_x[p] (u[p + 1] - u[p] - gradient_x[p])^2`` over horizontal neighbours and of
    ``weight_y[p] (u[p + W] - u[p] - gradient_y[p])^2`` over vertical ones, of which at least one is in the domain;
    u is `fixed` elsewhere.

    Parameters
    ----------
    domain
        ``(H, W)`` bool, the pixels to solve for.
    fixed
        ``(H, W)`` float32, u outside the domain.
    data, data_weight
        ``(H, W)`` float32, wanted values and their weights (>= 0); where the weight is 0 data may be anything.
    gradient_x, weight_x
        ``(H, W)`` float32, wanted difference to the next column and its weight (>= 0); the last column is ignored.
    gradient_y, weight_y
        The same for the next row; the last row is ignored.
    lower
        ``(H, W)`` float32, bound of u in the domain, -inf for none. None: no bounds.
    tolerance
        In the units of u: the solver stops when it estimates the largest error to be below.
    threads
        Threads that set up the equations; None takes all processors. One thread solves them; it holds no lock, so
        the channels of an image can be solved side by side.

    Returns
    -------
    ``(H, W)`` float32, equal to `fixed` outside the domain.

    Raises
    ------
    InputError
        The shapes differ, or something that counts is not finite, or a weight is negative.

    Notes
    -----
    A part of the domain that has no pixel with a data weight, and no weight towards a pixel outside, is not
    determined. It gets `data` where that is finite, else `lower` where that is finite, else 0, and never less than
    `lower`.

    Conjugate gradients, preconditioned by a multigrid cycle whose interpolation follows the weights (Dendy, "Black
    box multigrid", Journal of Computational Physics 48, 1982). With bounds, multigrid cycles that heed them on all
    grids (Kornhuber, "Monotone multigrid methods for elliptic variational inequalities I", Numerische Mathematik
    69, 1994) find the pixels at their bound, and conjugate gradients solve for the others; both by turns, neither
    of which raises the sum, until the image changes no more. Time and memory grow with the number of pixels in
    the bounding box of the domain: 12 float32 numbers each, 15 with bounds.
    """
    shape = domain.shape
    images = [data, data_weight, gradient_x, gradient_y, weight_x, weight_y]
    bounds = [] if lower is None else [lower]
    if domain.ndim != 2 or any(image.shape != shape for image in [fixed, *images, *bounds]):
        raise InputError("The arrays of the screened Poisson equation differ in shape; give all as (H, W).")
    result = np.array(fixed, dtype=np.float32, order="C")
    if domain.any():
        window = _window(domain)
        _check(domain[window], [image[window] for image in images], [bound[window] for bound in bounds])
        _solve(_Problem(window, np.ascontiguousarray(domain[window]), result, images, bounds, threads), tolerance)
    return result


class _Problem:
    """What is to be solved: a window of images, of which only that is looked at."""

    def __init__(
        self,
        window: tuple[slice, slice],
        free: NDArray[np.bool_],
        result: NDArray[np.float32],
        images: list[NDArray[np.float32]],
        bounds: list[NDArray[np.float32]],
        threads: int | None,
    ) -> None:
        self.free = free
        """The pixels to solve for, of the window."""
        self.image = result[window]
        """The solution so far, a view of the result."""
        self.bounds = [bound[window] for bound in bounds]
        """Lower bounds, or none."""
        self.data = images[0][window]
        self.grids = _allocate(*free.shape, bounded=bool(bounds))
        self._planes = tuple(np.ascontiguousarray(plane, dtype=np.float32) for plane in (result, *images))
        self._lower = np.ascontiguousarray(bounds[0], dtype=np.float32) if bounds else self._planes[0]
        self._corner = np.array([part.start for part in window])
        self._threads = threads

    def assemble(self) -> None:
        """Write the equations of the free pixels, for what is to be added to the image, into the finest grid."""
        shape = (len(self._planes) + 2, STRIP_ROWS + 2, 2 * self.grids.table[0, 2] + LANES)
        inputs = (self.grids, self.free, self._planes, self._lower, self._corner)

        def task(start: int, stop: int) -> None:
            strip = np.zeros(shape, dtype=np.float32)
            kernels.assemble(*inputs, strip, start, stop, bool(self.bounds))

        run_strips(task, len(self.free), strip_rows=TASK_ROWS, threads=self._threads)


def _window(domain: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns of the domain's bounding box, and one more on each side."""
    rows = np.flatnonzero(domain.any(axis=1))
    columns = np.flatnonzero(domain.any(axis=0))
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)


def _check(
    domain: NDArray[np.bool_], images: list[NDArray[np.float32]], bounds: list[NDArray[np.float32]]
) -> None:
    """Refuse weights and bounds that make no sense where they count."""
    _, data_weight, _, _, weight_x, weight_y = images
    for name, weights, counts in (
        ("data_weight", data_weight, lambda: domain),
        ("weight_x", weight_x[:, :-1], lambda: domain[:, :-1] | domain[:, 1:]),
        ("weight_y", weight_y[:-1], lambda: domain[:-1] | domain[1:]),
    ):
        if weights.size and not (weights.min() >= 0 and weights.max() < np.inf):
            wrong = counts() & ~((weights >= 0) & (weights < np.inf))
            if wrong.any():
                raise InputError(f"{name} holds {weights[wrong][0]}; weights must be finite and not negative.")
    for bound in bounds:
        if not bound.max() < np.inf and not (bound[domain] < np.inf).all():
            raise InputError("lower holds inf or nan; give -inf where there is no bound.")


def _solve(problem: _Problem, tolerance: float) -> None:
    """Write the solution into the free pixels of the image."""
    grids, domain, image, bounds = problem.grids, problem.free, problem.image, problem.bounds
    image[domain] = 0
    problem.assemble()
    if kernels.drop_undetermined(grids, grids.direction.view(np.int32)):
        free = np.zeros_like(image)
        _add(free, grids.inverse, grids)
        problem.free = free > 0
        lost = domain & ~problem.free
        image[lost] = _default(*(plane[lost] for plane in (problem.data, *bounds)))
    kernels.coarsen(grids)
    if not bounds:
        _solve_freely(problem, tolerance)
        return
    # The bounds may change much of the solution, which then need not be known well before.
    _conjugate_gradients(grids, 100 * tolerance)
    _add(image, grids.step, grids)
    if kernels.largest_deficit(grids) == 0:
        problem.assemble()
        _solve_freely(problem, tolerance)
    deficit = kernels.largest_deficit(grids)
    np.maximum(image, bounds[0], out=image, where=problem.free)
    if deficit > ENOUGH * tolerance:
        _heed_bounds(problem, tolerance)


def _solve_freely(problem: _Problem, tolerance: float) -> None:
    """Improve an image until it is the best, without regard to bounds.

    Where little anchors much, rounding errors of the residual move it. So it is taken anew from the image, until
    this moves nothing further than what was left to do.
    """
    for number in range(MOST_ROUNDS):
        moved = _conjugate_gradients(problem.grids, tolerance if number > 0 else 4 * tolerance)
        _add(problem.image, problem.grids.step, problem.grids)
        if moved <= (8 * tolerance if number > 0 else 0):
            return
        problem.assemble()
    _warn("rounding")


def _heed_bounds(problem: _Problem, tolerance: float) -> None:
    """Improve an image that keeps the bounds until it is the best that does.

    In each round, multigrid cycles that heed the bounds tell which pixels stay there; the others are solved for as
    if there were no bounds, and put back above them. Nothing raises the sum that is minimised.
    """
    grids = problem.grids
    deficit = np.inf
    for number in range(MOST_ROUNDS):
        first = number == 0
        problem.assemble()
        if number > 1 and max(deficit, kernels.largest_pull(grids)) < ENOUGH * tolerance:
            return
        grids.correction[:] = 0
        if number % 4 == 0:  # in between, the pixels at their bound change little
            if not first:
                kernels.coarsen(grids)
            for _ in range(5 if first else 1):
                kernels.cycle(grids, True)
                if not kernels.take_solution(grids):
                    _sweep(grids)
        else:
            _sweep(grids)
        kernels.hold_bounded(grids)
        kernels.coarsen(grids)
        _conjugate_gradients(grids, 10 * tolerance if first else tolerance)
        deficit = kernels.project(grids)
        _add(problem.image, grids.correction, grids)
        np.maximum(problem.image, problem.bounds[0], out=problem.image, where=problem.free)
    _warn("the bounds")


def _sweep(grids: kernels.Grids) -> None:
    """Improve `grids.correction` on the finest grid alone, which never fails to."""
    kernels.sweep(grids)
    kernels.take_solution(grids)


def _conjugate_gradients(grids: kernels.Grids, tolerance: float) -> float:
    """Write the solution into `grids.step`; the right-hand side becomes the residual.

    Returns how far a pixel can have moved.
    """
    grids.step[:] = grids.direction[:] = 0
    before = np.inf
    moved = last_change = 0.0
    for iteration in range(MOST_ITERATIONS):
        product = kernels.cycle(grids, False)
        if product <= 0:  # only the residual 0, or one as small as rounding errors
            return moved
        change = kernels.conjugate_step(grids, product, product / before)
        if not np.isfinite(change):
            raise InputError("Data, gradient or fixed values are not finite where their weight is not 0.")
        moved += change
        # The changes shrink about geometrically; what is left is estimated by their sum to infinity.
        rate = min(max(change / last_change, 0.3), 0.9) if iteration > 0 else 0.5
        if max(change, 0.5 * last_change) * rate / (1 - rate) < tolerance:
            return moved
        before, last_change = product, change
    _warn("conjugate gradients")
    return moved


def _warn(what: str) -> None:
    warnings.warn(
        f"The screened Poisson equation was not solved to its tolerance ({what}); weights may differ too much.",
        StereoHdrWarning,
        stacklevel=4,
    )


def _default(data: NDArray[np.float32], lower: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
    """Return the values of pixels that nothing determines."""
    values = np.where(np.isfinite(data), data, -np.inf)
    if lower is not None:
        values = np.maximum(values, lower)
    return np.where(np.isfinite(values), values, 0)


def _add(image: NDArray[np.float32], values: NDArray[np.float32], grids: kernels.Grids) -> None:
    """Add values of the finest grid to an image."""
    height, width = image.shape
    stride = grids.table[0, 2]
    halves = values[: 2 * (height + 2) * stride].reshape(height + 2, 2, stride)[1:-1, :, LANES:]
    image[:, 0::2] += halves[:, 0, : (width + 1) // 2]
    image[:, 1::2] += halves[:, 1, : width // 2]


def _allocate(height: int, width: int, *, bounded: bool) -> kernels.Grids:
    """Allocate the grids for an image of this size, down to one of a single pixel."""
    table = []
    start = first = blocks = 0
    while True:
        columns = (width + 1) // 2
        vectors = -(-columns // LANES)
        stride = (vectors + 1) * LANES
        table.append((height, columns, stride, start, first, blocks))
        start += 2 * (height + 2) * stride
        first += height + 4
        blocks += height * vectors
        if height == 1 and width == 1:
            break
        height, width = (height + 1) // 2, columns
    finest = table[1][3] if len(table) > 1 else start
    sizes = {
        "solution": start,
        "rhs": start,
        "inverse": start,
        "screen": start,
        "right": start,
        "down": start,
        "edge": start,
        "right_down": start - finest,
        "left_down": start - finest,
        "lower": start if bounded else 0,
        "correction": finest if bounded else 0,
        "step": finest,
        "direction": finest,
        "scratch": kernels.SCRATCH_ROWS * (table[0][2] + 3 * LANES),
    }
    # One array, for which the system may use huge pages; each part begins where a vector does.
    ends = np.cumsum([size + MARGIN for size in sizes.values()])
    flat = np.zeros(ends[-1] + LANES, dtype=np.float32)
    flat = flat[-flat.ctypes.data // 4 % LANES :]
    parts = {name: flat[end - MARGIN - size : end] for (name, size), end in zip(sizes.items(), ends, strict=True)}
    return kernels.Grids(
        table=np.array(table, dtype=np.int64),
        first=np.zeros(first, dtype=np.int32),
        blocks=np.zeros(blocks, dtype=np.int32),
        **parts,
    )
