"""Random requests on every door: none is answered by a fault, none changes anything.

`benchmarks/panel_fuzz.py` sends many more.
"""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest
from support.panel.served import ServedPanel, Visitor
from support.panel.wild import DOORS, in_control, let_a_flood_through, send_wild

COUNT = 250


@pytest.fixture(scope="module")
def panel() -> Iterator[ServedPanel]:
    patch = pytest.MonkeyPatch()
    let_a_flood_through(patch)
    with ServedPanel() as served:
        yield served
    patch.undo()


@pytest.fixture(scope="module")
def host(panel: ServedPanel) -> Visitor:
    return panel.visitor()


@pytest.fixture
def visitor(panel: ServedPanel, host: Visitor) -> Iterator[Visitor]:
    with in_control(panel, host) as visitor:
        yield visitor


@pytest.mark.parametrize(("method", "known"), DOORS)
def test_random_requests_to_panel_change_nothing(
    panel: ServedPanel, visitor: Visitor, method: str, known: str
) -> None:
    random_ = random.Random(f"{method} {known}")
    before = panel.rig.changes
    seen: set[int] = set()
    for _ in range(COUNT):
        status, request = send_wild(random_, visitor, method, known)
        assert status < 500, request
        seen.add(status)
    assert seen & {400, 401, 403, 404, 405}, "random requests are refused"
    assert panel.rig.changes == before
    assert visitor.get("/api/session")[0] == 200, "it still serves"
