"""YAML to data with places: what is accepted, and the place of what is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.document import MAX_BYTES, parse_document, read_document
from rigd.model import ConfigError, Place

FILE = Path("rig.yaml")


def test_scalars_stay_as_written() -> None:
    text = "a: 1.50\nb: no\nc: 0o17\nd: '~'\ne: ~\nf:\ng: 1_000\nh: 2026-01-01\n"
    data = parse_document(text, FILE).data
    assert data == {
        "a": "1.50", "b": "no", "c": "0o17", "d": "~", "e": None, "f": None, "g": "1_000",
        "h": "2026-01-01",
    }  # fmt: skip


def test_places_of_keys_and_values() -> None:
    document = parse_document("a:\n  bc: [x, 'y z']\n", FILE)
    assert document.key_place(("a", "bc")) == Place("rig.yaml", 2, 3)
    assert document.place(("a", "bc")) == Place("rig.yaml", 2, 7)
    assert document.place(("a", "bc", 1)) == Place("rig.yaml", 2, 11)


def test_text_of_another_file_has_places_there() -> None:
    text = "a: [x, y]\n"
    here, there = parse_document(text, FILE), parse_document(text, Path("other.yaml"))
    assert parse_document(text, FILE) is here  # not parsed again
    assert here.place(("a", 1)) == Place("rig.yaml", 1, 8)
    assert there.place(("a", 1)) == Place("other.yaml", 1, 8)


def test_text_that_is_refused_is_refused_again() -> None:
    for _ in range(2):
        with pytest.raises(ConfigError):
            parse_document("a: 1\na: 2\n", FILE)


def test_place_inside_text_counts_the_quote() -> None:
    document = parse_document("a: 'one two'\nb: one two\nc: |\n  one two\n", FILE)
    assert document.inside(("a",), 4) == Place("rig.yaml", 1, 9)
    assert document.inside(("b",), 4) == Place("rig.yaml", 2, 8)
    assert document.inside(("c",), 4) == Place("rig.yaml", 3, 4)


def test_missing_key_has_the_place_of_its_parent() -> None:
    document = parse_document("a:\n  b: 1\n", FILE)
    assert document.place(("a", "z", 3)) == Place("rig.yaml", 2, 3)


@pytest.mark.parametrize(
    ("text", "place", "part"),
    [
        ("a: 1\nb: 2\na: 3", "3:1", "key 'a' is given twice; first in line 1"),
        ("a: {b: 1, b: 2}", "1:11", "key 'b' is given twice"),
        ("a: &x 1\nb: *x", "1:4", "anchors and aliases"),
        ("b: *x", "1:4", "anchors and aliases"),
        ("a:\n  <<: {b: 1}", "2:3", "merge keys"),
        ("a: !!int 3", "1:4", "tags"),
        ("a: !mine {b: c}", "1:4", "tags"),
        ("a:\n\tb: 1", "2:1", "tab"),
        ("a: 1\n---\nb: 2", "2:1", "second document"),
        ("%YAML 1.1\n---\na: no", "2:1", "YAML version other than 1.2"),
        ("? [a, b]\n: 1", "1:3", "cannot be a key"),
        ("a: ${x\nb: {c: ${x}}", "2:9", "quote references"),
        ("a: b: c", "1:5", "a second ': '"),
        ("a: 'open", "1:4", "not closed"),
        ("a: b\n  c: d", "2:4", "indented too far"),
        ("a: \x07", "1:4", "U+0007"),
        ("a: 1\nb: \"\\Uffffffff\"", "2:1", "YAML 1.2"),
        ("", "1:1", "empty"),
        ("# only a comment\n", "1:1", "empty"),
        ("[" * 100_000, "1:25", "nested deeper than 24"),
        ("a: " + "{b: " * 40, "1:96", "nested deeper than 24"),
        ("- " * 5000, "1:49", "nested deeper than 24"),
    ],
)  # fmt: skip
def test_refused_with_its_place(text: str, place: str, part: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_document(text, FILE)
    assert str(caught.value).startswith(f"rig.yaml:{place}: ")
    assert part in str(caught.value)


def test_alias_bomb_is_refused_at_its_first_anchor() -> None:
    lines = ["a0: &a0 [x, x]"]
    lines += [f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60)]
    with pytest.raises(ConfigError, match="anchors"):
        parse_document("\n".join(lines), FILE)


def test_file_not_in_utf8_is_refused_at_byte(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_bytes("a: 1\nbé: ".encode() + b"\xff")
    with pytest.raises(ConfigError) as caught:
        read_document(file)
    assert str(caught.value).startswith(f"{file}:2:5: byte 0xff is not UTF-8")


def test_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(ConfigError, match="more than 512 KiB"):
        read_document(file)


def test_byte_order_mark_and_windows_lines_are_read(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    file.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert read_document(file).data == {"a": "1", "b": "2"}


def test_directory_and_missing_file_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.yaml"):
        with pytest.raises(ConfigError, match="cannot read"):
            read_document(path)
