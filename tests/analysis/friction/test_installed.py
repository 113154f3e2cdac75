"""Friction laws are found by entry point; an error in one is reported, and hides no other."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from rigd.analysis.friction import registry as module
from rigd.analysis.friction.registry import find_law, installed_laws
from rigd.config import registry
from rigd.config.registry import FRICTION_LAWS
from rigd.model.errors import ConfigError


@pytest.fixture
def with_broken(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Install two laws that cannot be used beside those that come with rigd."""
    folder = tmp_path_factory.mktemp("package")
    (folder / "broken_laws.py").write_text(
        "from rigd.analysis.friction import FrictionLaw, step\n\n\n"
        "class Silent(FrictionLaw):\n"
        "    @staticmethod\n"
        "    def steady(theta, slip_m_s, rolling_m_s):\n"
        "        return slip_m_s\n"
    )
    (folder / "uncompiled_law.py").write_text(
        "from rigd.analysis.friction import step\n\n\n"
        "@step\ndef wrong(state, theta, between, slip, rolling, dt):\n"
        "    return undefined_name\n"
    )
    monkeypatch.syspath_prepend(str(folder))
    known = {
        **registry.installed(FRICTION_LAWS),
        "silent": EntryPoint("silent", "broken_laws:Silent", FRICTION_LAWS),
        "uncompiled": EntryPoint("uncompiled", "uncompiled_law:Law", FRICTION_LAWS),
        "gone": EntryPoint("gone", "no_such_module:Law", FRICTION_LAWS),
    }
    for place in (registry, module):
        monkeypatch.setattr(place, "installed", lambda group: known)


def test_an_unknown_law_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="no friction law 'dhal' is installed") as caught:
        find_law("dhal")
    assert "dahl" in (caught.value.hint or "")


@pytest.mark.usefixtures("with_broken")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("silent", "Silent has no parameters, step"),
        ("uncompiled", "cannot be compiled"),
        ("gone", "cannot be loaded"),
    ],
)
def test_a_broken_law_is_refused_with_a_reason(name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        find_law(name)


@pytest.mark.usefixtures("with_broken")
def test_broken_laws_hide_no_other() -> None:
    laws, broken = installed_laws()
    assert {"dahl", "lugre", "maxwell-slip"} <= laws.keys()
    assert len(broken) == 3
