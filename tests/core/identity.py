"""Equality to the last bit, which is what the network promises."""

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.simulate import History


def bits(parameters: Parameters) -> tuple[bytes, bytes]:
    return parameters.theta.tobytes(), parameters.omega.tobytes()


def assert_same_histories(found: History, expected: History) -> None:
    """Every learner, every iteration, every bit of theta and omega."""
    assert found.keys() == expected.keys()
    for name, reference in expected.items():
        assert len(found[name]) == len(reference), f"{name}: {len(found[name])} of {len(reference)} iterations"
        for iteration, (one, other) in enumerate(zip(found[name], reference, strict=True), start=1):
            assert bits(one) == bits(other), f"{name} differs at iteration {iteration}"
