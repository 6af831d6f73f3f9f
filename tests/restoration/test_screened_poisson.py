import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from stereohdr.errors import InputError
from stereohdr.float_vectors import LANES
from stereohdr.restoration import _screened_poisson_kernels as kernels
from stereohdr.restoration import screened_poisson
from stereohdr.restoration.screened_poisson import solve_screened_poisson

from reference import screened_poisson as twin

TOLERATED = 1e-3
"""Error; the wanted accuracy is 2e-3, typical errors are a hundred times smaller than this."""


def image(values):
    return np.array(values, dtype=np.float32)


def random_case(seed, height, width):
    """A case with weights over three decades and few or many anchors; every part is anchored."""
    rng = np.random.default_rng(seed)
    shape = (height, width)
    smooth = ndimage.gaussian_filter(rng.standard_normal(shape), rng.choice([0.3, 2.0]))
    domain = smooth <= np.quantile(smooth, rng.choice([0.3, 0.7, 1.0]))
    if rng.random() < 0.5:
        weight_x, weight_y = 10.0 ** rng.uniform(1, 3, (2, *shape))
    else:
        weight_x, weight_y = np.where(ndimage.gaussian_filter(rng.standard_normal((2, *shape)), 2) > 0, 10, 1000)
    data_weight = np.where(rng.random(shape) < rng.choice([0.0, 0.05, 1.0]), 10.0 ** rng.uniform(0, 3, shape), 0)
    if domain.all():
        data_weight[height // 2, width // 2] = 1
    fixed, data = rng.uniform(-20, 20, (2, *shape))
    gradient_x, gradient_y = rng.standard_normal((2, *shape))
    images = {
        "fixed": fixed,
        "data": data,
        "data_weight": data_weight,
        "gradient_x": gradient_x,
        "gradient_y": gradient_y,
        "weight_x": weight_x,
        "weight_y": weight_y,
    }
    return {"domain": domain} | {name: values.astype(np.float32) for name, values in images.items()}


def membrane(domain, fixed, **images):
    """A case without data and gradient, all weights 1."""
    defaults = {
        name: np.full(domain.shape, int(name in ("weight_x", "weight_y")), dtype=np.float32)
        for name in ("data", "data_weight", "gradient_x", "gradient_y", "weight_x", "weight_y")
    }
    return {"domain": domain, "fixed": fixed} | defaults | images


sizes = {"seed": st.integers(0, 10**6), "height": st.integers(1, 12), "width": st.integers(1, 12)}


@given(**sizes)
def test_equals_a_dense_solve_of_the_definition(seed, height, width):
    case = random_case(seed, height, width)
    domain = case["domain"]
    got = solve_screened_poisson(**case)
    np.testing.assert_allclose(got[domain], np.linalg.solve(*twin.equations(**case)), atol=TOLERATED)
    np.testing.assert_array_equal(got[~domain], case["fixed"][~domain])


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 7), width=st.integers(1, 7))
def test_with_bounds_equals_projected_sweeps(seed, height, width):
    case = random_case(seed, height, width)
    domain = case["domain"]
    rng = np.random.default_rng(seed)
    free = solve_screened_poisson(**case)
    bounded = rng.random(domain.shape) < rng.random()
    lower = np.where(bounded, free + rng.normal(-0.2, 0.7, domain.shape), -np.inf).astype(np.float32)
    got = solve_screened_poisson(**case, lower=lower)
    expected = twin.minimise(*twin.equations(**case), lower[domain].astype(float))
    np.testing.assert_allclose(got[domain], expected, atol=TOLERATED)
    assert (got >= lower)[domain].all()
    np.testing.assert_array_equal(got[~domain], case["fixed"][~domain])


@pytest.mark.parametrize("seed", range(6))
def test_larger_images_equal_a_sparse_solve(seed):
    case = random_case(seed, 61, 85)
    matrix, right = sparse_equations(**case)
    got = solve_screened_poisson(**case)
    np.testing.assert_allclose(got[case["domain"]], splu(matrix).solve(right), atol=TOLERATED)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["flat", "rough", "parts"])
def test_larger_bounded_images_equal_an_active_set_method(seed, kind):
    case = random_case(seed, 61, 85)
    domain = case["domain"]
    rng = np.random.default_rng(seed)
    free = solve_screened_poisson(**case)
    lower = {
        "flat": np.full(domain.shape, np.quantile(free[domain], 0.4)),
        "rough": free + rng.normal(-0.2, 0.3, domain.shape),
        "parts": np.where(ndimage.gaussian_filter(rng.standard_normal(domain.shape), 4) > 0, free + 0.3, -np.inf),
    }[kind].astype(np.float32)
    got = solve_screened_poisson(**case, lower=lower)
    assert (got >= lower)[domain].all()
    matrix, right = sparse_equations(**case)
    expected = active_set(matrix, right, lower[domain].astype(float))
    np.testing.assert_allclose(got[domain], expected, atol=TOLERATED)


def sparse_equations(domain, fixed, *, data, data_weight, gradient_x, gradient_y, weight_x, weight_y):
    """Like `twin.equations`, from differences of neighbours."""
    index = np.arange(domain.size).reshape(domain.shape)
    weights = np.where(domain, data_weight, 0).reshape(-1).astype(float)
    matrix, right = sparse.diags(weights).tocsr(), weights * data.reshape(-1)
    for here, there, weight, gradient in (
        (index[:, :-1], index[:, 1:], weight_x[:, :-1], gradient_x[:, :-1]),
        (index[:-1], index[1:], weight_y[:-1], gradient_y[:-1]),
    ):
        count = np.arange(here.size)
        signs = np.repeat([-1.0, 1.0], here.size)
        columns = np.concatenate([here.reshape(-1), there.reshape(-1)])
        difference = sparse.csr_matrix((signs, (np.tile(count, 2), columns)), shape=(here.size, domain.size))
        weight = weight.reshape(-1).astype(float)
        matrix = matrix + difference.T @ sparse.diags(weight) @ difference
        right = right + difference.T @ (weight * gradient.reshape(-1))
    inside = domain.reshape(-1)
    rows = matrix.tocsr()[inside]
    return rows[:, inside].tocsc(), right[inside] - rows[:, ~inside] @ fixed.reshape(-1)[~inside].astype(float)


def active_set(matrix, right, lower):
    """Minimum of x A x / 2 - b x over x >= lower; converges for these matrices (Hintermueller et al., 2002)."""
    x = splu(matrix).solve(right)
    held = np.zeros(x.size, dtype=bool)
    while True:
        new = (x < lower) | (held & (matrix @ x > right))
        if (new == held).all() and held.any() | (x >= lower).all():
            return x
        held = new
        x = np.where(held, lower, 0.0)
        if not held.all():
            rows = matrix[~held]
            x[~held] = splu(rows[:, ~held].tocsc()).solve(right[~held] - rows[:, held] @ lower[held])


def test_a_membrane_on_a_line_by_hand():
    domain = np.array([[False, True, True, False]])
    got = solve_screened_poisson(**membrane(domain, image([[0, 9, 9, 3]])))
    np.testing.assert_allclose(got, [[0, 1, 2, 3]], atol=1e-5)
    got = solve_screened_poisson(**membrane(domain.T, image([[0, 9, 9, 3]]).T))
    np.testing.assert_allclose(got, [[0], [1], [2], [3]], atol=1e-5)


def test_a_gradient_and_its_weight_by_hand():
    domain = np.array([[False, True, False]])
    case = membrane(domain, image([[1, 0, 1]]), gradient_x=image([[3, 0, 7]]), weight_x=image([[3, 1, 9]]))
    # 3 (u - 1 - 3)^2 + (1 - u)^2 is least at u = 13 / 4.
    np.testing.assert_allclose(solve_screened_poisson(**case), [[1, 3.25, 1]], atol=1e-5)


def test_data_and_its_weight_by_hand():
    domain = np.array([[False, True]])
    case = membrane(domain, image([[1, 0]]), data=image([[0, 5]]), data_weight=image([[9, 3]]))
    np.testing.assert_allclose(solve_screened_poisson(**case), [[1, 4]], atol=1e-5)  # 3 (u - 5)^2 + (u - 1)^2
    alone = membrane(np.array([[True]]), image([[1]]), data=image([[5]]), data_weight=image([[3]]))
    np.testing.assert_allclose(solve_screened_poisson(**alone), [[5]], atol=1e-5)


def test_a_string_over_an_obstacle_by_hand():
    domain = np.array([[False] + [True] * 7 + [False]])
    lower = image([[9, -np.inf, -np.inf, 6, -np.inf, 1, -np.inf, -np.inf, 9]])
    got = solve_screened_poisson(**membrane(domain, np.zeros((1, 9), np.float32)), lower=lower)
    np.testing.assert_allclose(got, [[0, 2, 4, 6, 4.8, 3.6, 2.4, 1.2, 0]], atol=1e-5)


@settings(max_examples=40)
@given(**sizes)
def test_any_domain_gives_something_finite_above_the_bounds(seed, height, width):
    rng = np.random.default_rng(seed)
    shape = (height, width)
    domain = rng.random(shape) < rng.random()
    weights = np.where(rng.random((3, *shape)) < rng.random(), 10 ** rng.uniform(-1, 3, (3, *shape)), 0)
    values = rng.uniform(-20, 20, (4, *shape))
    values[:, rng.random(shape) < 0.2] = np.nan
    weights[0, np.isnan(values[1])] = weights[1, np.isnan(values[2])] = weights[2, np.isnan(values[3])] = 0
    fixed, data, gradient_x, gradient_y = values.astype(np.float32)
    data_weight, weight_x, weight_y = weights.astype(np.float32)
    fixed = np.nan_to_num(fixed)
    lower = np.where(rng.random(shape) < 0.5, rng.uniform(-20, 20, shape), -np.inf).astype(np.float32)
    case = {"data": data, "data_weight": data_weight, "gradient_x": gradient_x, "gradient_y": gradient_y}
    case |= {"weight_x": weight_x, "weight_y": weight_y}
    for bounds in (None, lower):
        got = solve_screened_poisson(domain, fixed, **case, lower=bounds)
        assert np.isfinite(got).all()
        np.testing.assert_array_equal(got[~domain], fixed[~domain])
    assert (got >= lower)[domain].all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (1, 33), (33, 1), (2, 2), (3, 64), (65, 3)])
def test_a_domain_without_pixels_and_one_without_others(shape):
    rng = np.random.default_rng(1)
    fixed = rng.random(shape).astype(np.float32)
    nothing = membrane(np.zeros(shape, dtype=bool), fixed)
    np.testing.assert_array_equal(solve_screened_poisson(**nothing), fixed)
    data = rng.random(shape).astype(np.float32)
    gradient_x, gradient_y = np.diff(data, axis=1, append=0), np.diff(data, axis=0, append=0)
    weight = np.zeros(shape, dtype=np.float32)
    weight[-1, -1] = 2
    everything = membrane(
        np.ones(shape, dtype=bool),
        fixed,
        data=data,
        data_weight=weight,
        gradient_x=gradient_x,
        gradient_y=gradient_y,
    )
    np.testing.assert_allclose(solve_screened_poisson(**everything), data, atol=1e-5)


def test_parts_without_anchor_get_data_else_the_bound_else_zero():
    domain = np.array([[True, True, True, True, False, True, False]])
    apart = image([[1, 0, 1, 0, 0, 5, 0]])  # pairs: 0-1, 2-3, and pixel 5 with the fixed pixel after it
    data = image([[7, np.nan, np.nan, 2, 8, 8, 8]])
    lower = image([[-np.inf, 3, -np.inf, 4, 0, -np.inf, 0]])
    case = membrane(domain, image([[0, 0, 0, 0, 1, 0, 6]]), data=data, weight_x=apart, weight_y=np.zeros((1, 7)))
    np.testing.assert_allclose(solve_screened_poisson(**case), [[7, 0, 0, 2, 1, 6, 6]], atol=1e-5)
    np.testing.assert_allclose(solve_screened_poisson(**case, lower=lower), [[7, 3, 0, 4, 1, 6, 6]], atol=1e-5)


def test_a_large_part_without_anchor_keeps_its_data_beside_one_that_has():
    rng = np.random.default_rng(0)
    data = rng.random((90, 70)).astype(np.float32)
    domain = np.ones((90, 70), dtype=bool)
    domain[:, 40] = False
    fixed = np.full((90, 70), 2, dtype=np.float32)
    weight_x = np.ones((90, 70), dtype=np.float32)
    weight_x[:, 39] = 0
    got = solve_screened_poisson(**membrane(domain, fixed, data=data, weight_x=weight_x))
    np.testing.assert_array_equal(got[:, :40], data[:, :40])
    np.testing.assert_allclose(got[:, 40:], 2, atol=1e-4)


def test_a_single_anchor_holds_a_large_image():
    """Rounding errors of all pixels together must not move it, nor weights that jump."""
    rng = np.random.default_rng(2)
    height, width = 150, 230
    truth = (3 * ndimage.gaussian_filter(rng.standard_normal((height, width)), 2)).astype(np.float32) * 20
    weight = np.where(ndimage.gaussian_filter(rng.standard_normal((height, width)), 6) > 0, 10, 1000)
    domain = np.ones((height, width), dtype=bool)
    domain[70, 31] = False
    case = membrane(
        domain,
        truth,
        gradient_x=np.diff(truth, axis=1, append=0),
        gradient_y=np.diff(truth, axis=0, append=0),
        weight_x=weight.astype(np.float32),
        weight_y=weight.astype(np.float32),
    )
    np.testing.assert_allclose(solve_screened_poisson(**case), truth, atol=TOLERATED)


@pytest.mark.parametrize("bounded", [False, True])
def test_mirrored_input_gives_the_mirrored_image(bounded):
    case = random_case(3, 40, 53)
    if bounded:
        case["lower"] = np.full((40, 53), 3, dtype=np.float32)
    case["gradient_x"][:, -1] = case["weight_x"][:, -1] = 0
    mirrored = {name: values[:, ::-1] for name, values in case.items()}
    mirrored["gradient_x"] = -np.roll(case["gradient_x"], 1, axis=1)[:, ::-1]
    mirrored["weight_x"] = np.roll(case["weight_x"], 1, axis=1)[:, ::-1]
    got = solve_screened_poisson(**mirrored)[:, ::-1]
    np.testing.assert_allclose(got, solve_screened_poisson(**case), atol=TOLERATED)


@pytest.mark.parametrize("bounded", [False, True])
def test_the_same_bytes_for_any_number_of_threads(bounded, monkeypatch):
    monkeypatch.setattr(screened_poisson, "TASK_ROWS", 2 * screened_poisson.STRIP_ROWS)
    case = random_case(5, 100, 75)
    lower = np.full((100, 75), -1, dtype=np.float32) if bounded else None
    one = solve_screened_poisson(**case, lower=lower, threads=1)
    assert one.tobytes() == solve_screened_poisson(**case, lower=lower, threads=3).tobytes()
    assert one.tobytes() == solve_screened_poisson(**case, lower=lower).tobytes()


def test_bounds_that_are_kept_anyway_change_nothing_but_rounding():
    case = random_case(8, 45, 45)
    free = solve_screened_poisson(**case)
    for lower in (free - 1, np.full_like(free, -np.inf)):
        np.testing.assert_allclose(solve_screened_poisson(**case, lower=lower), free, atol=TOLERATED)


def test_input_is_left_alone_and_may_have_any_layout():
    case = random_case(7, 30, 41)
    lower = np.zeros((30, 41), dtype=np.float32)
    before = {name: values.copy() for name, values in case.items()}
    expected = solve_screened_poisson(**case, lower=lower)
    for name, values in case.items():
        np.testing.assert_array_equal(values, before[name])
    turned = {name: np.asfortranarray(values, dtype=values.dtype) for name, values in case.items()}
    np.testing.assert_array_equal(solve_screened_poisson(**turned, lower=np.asfortranarray(lower)), expected)


def test_what_has_no_weight_may_be_anything():
    domain = np.zeros((7, 9), dtype=bool)
    domain[2:5, 2:6] = True
    plain = membrane(domain, np.full((7, 9), 2, dtype=np.float32))
    wild = {name: values.copy() for name, values in plain.items()}
    wild["data"][:] = np.nan
    wild["fixed"][0] = np.inf
    for name in ("gradient_x", "weight_x"):
        wild[name][:, -1] = wild[name][0] = np.nan
    wild["weight_y"][-1] = -1
    got = solve_screened_poisson(**wild)
    np.testing.assert_array_equal(got[1:], solve_screened_poisson(**plain)[1:])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("weight_x", -1, "weight_x holds -1.0; weights must be"),
        ("weight_y", np.nan, "weight_y holds nan"),
        ("data_weight", np.inf, "data_weight holds inf"),
        ("gradient_x", np.nan, "Data, gradient or fixed values are not finite"),
        ("fixed", np.inf, "Data, gradient or fixed values are not finite"),
        ("lower", np.nan, "lower holds inf or nan"),
        ("lower", np.inf, "lower holds inf or nan"),
    ],
)
def test_what_makes_no_sense_is_refused(name, value, message):
    domain = np.zeros((7, 9), dtype=bool)
    domain[2:5, 2:6] = True
    case = membrane(domain, np.zeros((7, 9), dtype=np.float32)) | {"lower": np.zeros((7, 9), dtype=np.float32)}
    case[name][:, 3] = value
    with pytest.raises(InputError, match=message):
        solve_screened_poisson(**case)


def test_arrays_of_different_shapes_are_refused():
    case = membrane(np.ones((3, 4), dtype=bool), np.zeros((3, 4), dtype=np.float32))
    with pytest.raises(InputError, match="differ in shape"):
        solve_screened_poisson(**case | {"weight_y": np.ones((4, 3), dtype=np.float32)})


# The kernels


def grids_of(case):
    """Return the grids of a case, with the equations and all coarser grids."""
    height, width = case["domain"].shape
    order = ("data", "data_weight", "gradient_x", "gradient_y", "weight_x", "weight_y")
    images = [case[name] for name in order]
    start = np.where(case["domain"], 0, case["fixed"])
    window = (slice(0, height), slice(0, width))
    problem = screened_poisson._Problem(window, case["domain"], start, images, [], 1)
    problem.assemble()
    return problem.grids


def read(grids, number, values, slanted=False):
    """Return a quantity of one grid as ``(rows, columns)``."""
    rows, columns, stride, start, _, _ = grids.table[number]
    start -= grids.table[1, 3] if slanted else 0
    halves = values[start : start + 2 * (rows + 2) * stride].reshape(rows + 2, 2, stride)
    return halves[1:-1, :, LANES : LANES + columns].transpose(0, 2, 1).reshape(rows, 2 * columns)


def matrix_of(grids, number):
    """Return the matrix of one grid, and which pixels are free."""
    screen = read(grids, number, grids.screen)
    rows, columns = screen.shape
    index = np.arange(screen.size).reshape(screen.shape)
    couplings = [(grids.right, 0, 1, False), (grids.down, 1, 0, False)]
    if number > 0:
        couplings += [(grids.right_down, 1, 1, True), (grids.left_down, 1, -1, True)]
    matrix = np.diag(screen.reshape(-1).astype(float))
    for values, down, right, slanted in couplings:
        coupling = read(grids, number, values, slanted)
        for y, x in np.argwhere(coupling):
            i, j = index[y, x], index[y + down, x + right]
            matrix[i, i] += coupling[y, x]
            matrix[j, j] += coupling[y, x]
            matrix[i, j] -= coupling[y, x]
            matrix[j, i] -= coupling[y, x]
    return matrix, read(grids, number, grids.inverse).reshape(-1) > 0, rows, columns


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 20), width=st.integers(1, 40))
def test_grids_are_the_equations_and_their_galerkin_products(seed, height, width):
    case = random_case(seed, height, width)
    if not case["domain"].any():
        return
    grids = grids_of(case)
    kernels.coarsen(grids)
    matrix, free, rows, columns = matrix_of(grids, 0)
    equations, _ = twin.equations(**case)
    np.testing.assert_array_equal(free.reshape(rows, columns)[:, :width], case["domain"])
    np.testing.assert_allclose(matrix[np.ix_(free, free)], equations, rtol=1e-6)
    for number in range(1, len(grids.table)):
        scale = np.abs(matrix).max()
        weights = twin.interpolation(matrix, free, rows, columns)
        expected = weights.T @ matrix @ weights
        matrix, free, rows, columns = matrix_of(grids, number)
        extent = (rows, grids.table[number - 1, 1])
        expected = embed(expected, extent, (rows, columns))
        np.testing.assert_allclose(
            matrix[np.ix_(free, free)], expected[np.ix_(free, free)], rtol=1e-4, atol=1e-5 * scale
        )
        inverse = read(grids, number, grids.inverse).reshape(-1)
        np.testing.assert_allclose(inverse[free] * np.diag(matrix)[free], 1, rtol=1e-4)


def embed(matrix, shape, larger):
    """Return a matrix between pixels of an image as one of a larger image."""
    index = np.arange(larger[0] * larger[1]).reshape(larger)[: shape[0], : shape[1]].reshape(-1)
    result = np.zeros((larger[0] * larger[1],) * 2)
    result[np.ix_(index, index)] = matrix
    return result


@pytest.mark.parametrize("seed", range(4))
def test_a_cycle_is_a_symmetric_matrix_near_the_inverse(seed):
    case = random_case(seed, 13, 37)
    grids = grids_of(case)
    kernels.coarsen(grids)
    matrix, free, _, _ = matrix_of(grids, 0)
    rows, columns, stride, *_ = grids.table[0]
    place = np.arange(2 * (rows + 2) * stride).reshape(rows + 2, 2, stride)[1:-1, :, LANES : LANES + columns]
    place = place.transpose(0, 2, 1).reshape(-1)[free]
    approximate = np.zeros((place.size, place.size))
    for column, i in enumerate(place):
        grids.rhs[: 2 * (rows + 2) * stride] = 0
        grids.rhs[i] = 1
        product = kernels.cycle(grids, False)
        approximate[:, column] = grids.solution[place]
        np.testing.assert_allclose(product, approximate[column, column], rtol=1e-6)
    np.testing.assert_allclose(approximate, approximate.T, atol=1e-5 * np.abs(approximate).max())
    eigenvalues = np.linalg.eigvals(approximate @ matrix[np.ix_(free, free)]).real
    assert eigenvalues.min() > 0.02
    assert eigenvalues.max() < 1.05


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 12), width=st.integers(1, 40))
def test_parts_without_anchor_are_found(seed, height, width):
    rng = np.random.default_rng(seed)
    case = random_case(seed, height, width)
    for name in ("weight_x", "weight_y"):
        case[name][rng.random((height, width)) < 0.5] = 0
    case["data_weight"][rng.random((height, width)) < 0.9] = 0
    domain = case["domain"]
    labels = twin.parts(domain, case["weight_x"], case["weight_y"])
    outside_x = (domain[:, :-1] != domain[:, 1:]) & (case["weight_x"][:, :-1] > 0)
    outside_y = (domain[:-1] != domain[1:]) & (case["weight_y"][:-1] > 0)
    anchors = case["data_weight"] > 0
    anchors[:, :-1] |= outside_x
    anchors[:, 1:] |= outside_x
    anchors[:-1] |= outside_y
    anchors[1:] |= outside_y
    expected = domain & np.isin(labels, labels[anchors & domain])
    grids = grids_of(case)
    dropped = kernels.drop_undetermined(grids, grids.direction.view(np.int32))
    assert dropped == (domain & ~expected).sum()
    np.testing.assert_array_equal(read(grids, 0, grids.inverse)[:, :width] > 0, expected)
