"""The first seconds of a process: no garbage is looked for, and nothing that a user has set is overruled."""

import gc
import os

import pytest

from mabirds_msgs_py.early import PLUGINS, loading, without_collection


def test_no_garbage_is_looked_for_while_modules_are_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PLUGINS, raising=False)
    frozen = gc.get_freeze_count()
    with loading():
        assert not gc.isenabled()
        assert os.environ[PLUGINS] == "__all__"
        kept = [[number] for number in range(1000)]
    assert gc.isenabled()
    assert gc.get_freeze_count() >= frozen + len(kept)
    gc.unfreeze()


def test_it_is_looked_for_again_whatever_happens() -> None:
    with pytest.raises(KeyError), without_collection():
        raise KeyError
    assert gc.isenabled()
    gc.unfreeze()


def test_a_choice_of_the_user_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLUGINS, "")
    gc.disable()
    try:
        with loading():
            pass
        assert not gc.isenabled()
        assert os.environ[PLUGINS] == ""
    finally:
        gc.enable()
