"""Hostile YAML: each file that rigd opens is refused with its place, whatever stands in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.config.calibration.calibration import load_calibration
from rigd.config.document import MAX_BYTES, read_document
from rigd.config.lab.lab import load_lab, read_specimen
from rigd.config.loader import load_rig
from rigd.config.settings import read_settings
from rigd.importing.map.map_reader import load_map
from rigd.model.errors import ConfigError
from rigd.procedure.loader import load_procedure
from rigd.remote.client.rigs.remotes import read_remotes
from rigd.sdk.shipped_files import shipped_folder
from rigd_sim.lugre.plant import LugrePlant
from rigd_sim.wire.faults import read_fault_file

PLANT = shipped_folder("configs") / "plants" / "lugre.yaml"


def read_parameters(path: Path) -> object:
    return LugrePlant.Config.model_validate({"parameters": str(path)}).files()


#: How each kind of file is read, and a key that it has, in which a bomb may stand.
READERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "rig": (load_rig, "cycle"),
    "procedure": (load_procedure, "repeats"),
    "lab": (load_lab, "lab"),
    "specimen": (lambda path: read_specimen(read_document(path)), "specimen"),
    "calibration": (load_calibration, "values"),
    "map": (load_map, "time"),
    "parameters": (read_parameters, "gravity"),
    "faults": (read_fault_file, "faults"),
    "settings": (read_settings, "default_rig"),
    "remotes": (lambda _: read_remotes(), "remotes"),
}
ALIASES = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 10)
)
BLOCKS = "\n".join(f"{' ' * n}a:" for n in range(3_000))
#: Each as the value of a key, and as the whole file.
BOMBS = {
    "integer": b"9" * 5_000,
    "hexadecimal": b"0x" + b"f" * 5_000,
    "octal": b"0o" + b"7" * 5_000,
    "sexagesimal": b"1:" * 3_000 + b"1",
    "exponent": b"1e" + b"9" * 300,
    "quantity": b"9" * 5_000 + b" N",
    "infinity": b".inf",
    "no number": b".nan",
    "flow lists": b"[" * 20_000 + b"]" * 20_000,
    "flow mappings": b"{a: " * 20_000,
    "block depth": BLOCKS.encode(),
    "lists in lists": b"- " * 3_000 + b"x",
    "aliases": ALIASES.encode(),
    "alias to itself": b"&a [*a]",
    "merge": b"{<<: {a: 1}}",
    "tag": b"!!python/object/apply:os.system ['true']",
    "binary": b"!!binary aGVsbG8=",
    "huge scalar": b"x" * 100_000,
    "huge quoted": b'"' + b"\\n" * 20_000 + b'"',
    "too long": b"x: 1\n" * (MAX_BYTES // 4),
    "many keys": b"".join(b"k%d: 1\n" % n for n in range(300)),
    "long key": b"k" * 10_000 + b": 1",
    "double key": b"a: 1\na: 2\n",
    "NUL": b"a: \x00",
    "escape": b"a: \x1b[2J",
    "not UTF-8": b"a: \xff\xfe",
    "cut UTF-8": b"a: \xe2\x82",
    "UTF-16": "a: 1".encode("utf-16"),
    "surrogate": b'"\\ud800"',
    "bad escape": b'"\\q"',
    "huge code point": b'"\\UFFFFFFFF"',
    "documents": b"---\na: 1\n---\nb: 2\n",
    "directive": b"%YAML 1.1\n---\na: 1\n",
    "unknown directive": b"%TAG ! tag:x,2000:\n---\n!a b\n",
    "tab": b"a:\n\t- b",
    "open quote": b'"' + b"x" * 10_000,
    "question key": b"? [a]\n: b",
    "empty": b"",
    "null": b"null",
}


@pytest.mark.parametrize("kind", READERS)
def test_no_bomb_is_more_than_an_error(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rigd").mkdir()
    path = tmp_path / "rigd" / "remotes.yaml"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    read, key = READERS[kind]
    passed = []
    for name, bomb in BOMBS.items():
        for text in (bomb, key.encode() + b": " + bomb):
            path.write_bytes(text)
            try:
                read(path)
            except ConfigError as error:
                assert str(path) in str(error) or path.name in str(error), name
            else:
                passed.append((name, text[:40]))
    # A file may have a name such as `.inf`, and a list of faults may be empty.
    right = {"settings": {"infinity", "no number"}, "faults": {"empty", "null"}}
    assert {name for name, _ in passed} == right.get(kind, set()), passed


def test_parameters_are_read_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "lugre.yaml"
    text = PLANT.read_text("utf-8")
    path.write_text(text)
    assert read_parameters(path) == {path: text}
    line = next(n for n, row in enumerate(text.splitlines(), 1) if "mass" in row and "kg" in row)
    rows = text.splitlines()
    rows[line - 1] = rows[line - 1].replace("kg", "N")
    path.write_text("\n".join(rows))
    with pytest.raises(ConfigError, match=rf"lugre\.yaml:{line}:\d+: "):
        read_parameters(path)
