"""The fixture of texts that a change of structure leaves as they are."""

from __future__ import annotations

import re
from functools import partial

import pytest
from contract.golden import ARITHMETIC, Check, arithmetic, same
from pytest_regressions.file_regression import FileRegressionFixture

from rigd import __version__

VERSION = re.compile(rf"(?<![\d.]){re.escape(__version__)}(?![\d.])")


@pytest.fixture
def unchanged(file_regression: FileRegressionFixture, request: pytest.FixtureRequest) -> Check:
    """Return what compares a text with the one that is kept under a name."""
    if request.config.getoption("force_regen"):
        ARITHMETIC.write_text(arithmetic() + "\n", "utf-8")
    compared = partial(same, exact=ARITHMETIC.read_text("utf-8").strip() == arithmetic())

    def check(name: str, text: str) -> None:
        text = VERSION.sub("VERSION", text)  # a release changes no behaviour
        file_regression.check(text, basename=name, encoding="utf-8", check_fn=compared)

    return check
