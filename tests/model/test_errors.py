"""Errors as people read them."""

from __future__ import annotations

from rigd.model.errors import ConfigError


def test_empty_hint_adds_no_line() -> None:
    assert str(ConfigError("wrong", hint="")) == "wrong"
    assert ConfigError("wrong", hint="").one_line == "wrong"
