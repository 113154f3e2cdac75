"""What the documents name can be imported from ``rigd.remote``."""

from __future__ import annotations

import pytest

import rigd.remote
from rigd.model.errors import RigdError


@pytest.mark.parametrize("name", ["Refusal", "LinkError"])
def test_error_of_documents_can_be_caught(name: str) -> None:
    assert issubclass(getattr(rigd.remote, name), RigdError)
