"""Where a library is missing that only some experiments need, the error says how to get it."""

import pytest

from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.extras import require


def test_what_is_there_is_no_error_and_what_is_not_has_a_remedy() -> None:
    require("numpy", "arrays", "somewhere[else]")
    with pytest.raises(ExperimentError, match=r"^birds: .*library no_such_library.*pip install 'somewhere\[else\]'$"):
        require("no_such_library", "birds", "somewhere[else]")
    with pytest.raises(MabirdsError) as caught:
        require("no_such_library", "birds", "somewhere[else]", MabirdsError)
    assert type(caught.value) is MabirdsError
