"""Numbers of a table in the memory of a compiled function."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rigd.model.gather import copies


@given(st.dictionaries(st.integers(0, 19), st.integers(0, 9), max_size=20))
def test_each_place_gets_its_number_alone(places: dict[int, int]) -> None:
    for kind, memory in (("d", np.full(20, -1.0)), ("q", np.full(20, -1))):
        table = [10 + place for place in range(10)]
        for copy in copies(kind, places, memory):  # type: ignore[arg-type]
            copy(table)
        assert memory.tolist() == [
            table[places[place]] if place in places else -1 for place in range(20)
        ]
