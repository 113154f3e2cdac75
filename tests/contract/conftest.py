"""The fixture of texts that a change of structure leaves as they are."""

from __future__ import annotations

from functools import partial

import pytest
from contract.golden import ARITHMETIC, Check, arithmetic, same
from pytest_regressions.file_regression import FileRegressionFixture


@pytest.fixture
def unchanged(file_regression: FileRegressionFixture, request: pytest.FixtureRequest) -> Check:
    """Return what compares a text with the one that is kept under a name."""
    if request.config.getoption("force_regen"):
        ARITHMETIC.write_text(arithmetic() + "\n", "utf-8")
    compared = partial(same, exact=ARITHMETIC.read_text("utf-8").strip() == arithmetic())

    def check(name: str, text: str) -> None:
        file_regression.check(text, basename=name, encoding="utf-8", check_fn=compared)

    return check
