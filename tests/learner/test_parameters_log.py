"""theta and omega of all iterations on disk."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from identity import bits

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import CheckpointError
from mabirds_learner.parameters_log import ParametersLog
from mabirds_learner.records import HEAD, HEADER

LIKE = Parameters(np.zeros(3), np.zeros(2))


def made_up(iteration: int) -> Parameters:
    rng = np.random.default_rng(iteration)
    return Parameters(rng.normal(size=3), rng.normal(size=2))


@pytest.fixture
def log(tmp_path: Path) -> Iterator[ParametersLog]:
    made = ParametersLog(tmp_path / "some" / "learner_1.log", LIKE, "run")
    yield made
    made.close()


def test_what_was_written_is_read_to_the_bit_in_any_order(log: ParametersLog, tmp_path: Path) -> None:
    for n in (3, 1, 200, 2, 1000):
        log[n] = made_up(n)
    log[3] = made_up(4)
    again = ParametersLog(tmp_path / "some" / "learner_1.log", LIKE, "run")
    for found in (log, again):
        assert list(found) == [1, 2, 3, 200, 1000]
        assert len(found) == 5
        assert found.newest == 1000
        assert bits(found[3]) == bits(made_up(4))
        assert bits(found[1000]) == bits(made_up(1000))
        assert (0 in found, 4 in found, 10**9 in found, "1" in found) == (False,) * 4
        assert found.gaps(5) == [4, 5]
        assert found.gaps(1001)[-2:] == [999, 1001]
    again.close()
    with pytest.raises(KeyError):
        log[4]


@pytest.mark.parametrize("place", [0, 9, 30, 56, 95])
def test_a_damaged_record_is_missing_and_no_other(log: ParametersLog, tmp_path: Path, place: int) -> None:
    for n in range(1, 6):
        log[n] = made_up(n)
    file, record = tmp_path / "some" / "learner_1.log", HEAD.size + 5 * 8
    content = bytearray(file.read_bytes())
    content[HEADER + 2 * record + place] ^= 1
    file.write_bytes(content)
    again = ParametersLog(file, LIKE, "run")
    assert again.gaps(5) == [3]
    again.close()
    assert log.get(3) is None  # damaged while it was open
    assert list(log) == [1, 2, 4, 5]


@pytest.mark.parametrize("cut", [1, 7, 8, 95])
def test_a_file_cut_short_holds_what_is_whole(log: ParametersLog, tmp_path: Path, cut: int) -> None:
    for n in range(1, 6):
        log[n] = made_up(n)
    file = tmp_path / "some" / "learner_1.log"
    os.truncate(file, file.stat().st_size - cut)
    again = ParametersLog(file, LIKE, "run")
    assert list(again) == [1, 2, 3, 4]
    again.close()


@pytest.mark.parametrize(("like", "run"), [(LIKE, "other"), (Parameters(np.zeros(4), np.zeros(2)), "run")])
def test_a_file_of_another_run_or_shape_is_refused(
    log: ParametersLog, tmp_path: Path, like: Parameters, run: str
) -> None:
    with pytest.raises(CheckpointError, match=r"expected 'mabirds-log-2 . (other|run)'"):
        ParametersLog(tmp_path / "some" / "learner_1.log", like, run)
    log[1] = made_up(1)  # and is left alone
    assert list(log) == [1]
