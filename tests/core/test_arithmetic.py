"""exp, log, tanh, powers and products, with compiled kernels and without, against numpy in long double."""

import numpy as np
import pytest

from mabirds_core import arithmetic
from mabirds_core.arithmetic import exp, log, power, powers, product, tanh
from mabirds_core.arrays import Array

RNG = np.random.default_rng(0)
SPANS = [1e-12, 0.3, 0.5001, 3.0, 100.0]


@pytest.fixture(params=["as built", "without kernels"], autouse=True)
def kernels(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "without kernels":
        monkeypatch.setattr(arithmetic, "library", lambda: None)


def far(values: Array, exact: np.ndarray) -> float:
    """Largest relative error."""
    return float(np.abs(values / exact - 1).max())


@pytest.mark.parametrize("span", SPANS)
def test_tanh(span: float) -> None:
    x = RNG.uniform(-span, span, size=(50, 40))
    assert far(tanh(x), np.tanh(x.astype(np.longdouble))) < 1e-15
    assert tanh(np.zeros(2)).tolist() == [0.0, 0.0]


def test_exp_and_log_keep_shapes_and_take_views() -> None:
    x = RNG.uniform(0.1, 3, size=(6, 8))[::2, ::3]
    assert far(exp(x), np.exp(x.astype(np.longdouble))) < 5e-16
    np.testing.assert_allclose(log(x), np.log(x), rtol=1e-14, atol=1e-16)
    assert exp(np.array(-1000.0)).shape == ()
    assert log(np.zeros(1)).tolist() == [-np.inf]


@pytest.mark.parametrize("exponent", [0.51, 0.75, -2.0])
def test_power(exponent: float) -> None:
    for base in (0.1, 1.0, 7.0, 1e5):
        assert power(base, exponent) == pytest.approx(base**exponent, rel=1e-14)


def test_powers_are_products() -> None:
    assert powers(0.5, 5).tolist() == [1.0, 0.5, 0.25, 0.125, 0.0625]
    assert powers(1.0, 3).tolist() == [1.0, 1.0, 1.0]
    assert powers(0.9, 0).shape == (0,)


@pytest.mark.parametrize("shape", [(3, 4, 5), (1, 7, 1), (2, 1, 3), (1, 500, 2)])
def test_product(shape: tuple[int, int, int]) -> None:
    rows, inner, columns = shape
    a, b = RNG.normal(size=(rows, inner)), RNG.normal(size=(inner, columns))
    np.testing.assert_allclose(product(a, b), a @ b, rtol=0, atol=1e-12)
