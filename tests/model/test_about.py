"""What a person states on a run is text, bounded, and steers no terminal."""

from __future__ import annotations

import pytest

from rigd.model.about import MOST_ENTRIES, MOST_NOTE_LETTERS, About, plain, visible


def test_ordinary_words_of_any_language_are_taken() -> None:
    about = About(
        "Zoë Müller-岡田", "two lines\n\tand a tab, 41 % 🧪", {"specimen": "W7", "T-2": "µ°C"}
    )
    assert about.meta["specimen"] == "W7"


@pytest.mark.parametrize(
    "letter", ["\x1b", "\x00", "\x07", "\x9b", "\r", "\u202e", "\udcff", "\u2028"]
)
def test_characters_that_steer_are_refused_by_number(letter: str) -> None:
    number = f"U\\+{ord(letter):04X}"
    with pytest.raises(ValueError, match=number):
        About(operator=f"A{letter}B")
    with pytest.raises(ValueError, match=number):
        About(note=f"A{letter}B")
    with pytest.raises(ValueError, match=number):
        About(meta={"specimen": f"A{letter}B"})
    escaped = letter.encode("unicode_escape").decode("ascii")
    assert plain(f"A{letter}\nB") == f"A{escaped} B"
    assert visible(f"A{letter}\n\tµ") == f"A{escaped}\n\tµ"


def test_operator_has_one_line() -> None:
    with pytest.raises(ValueError, match="operator"):
        About(operator="A\nB")


def test_note_or_metadata_beyond_bounds_is_refused() -> None:
    with pytest.raises(ValueError, match="the note has"):
        About(note="x" * (MOST_NOTE_LETTERS + 1))
    with pytest.raises(ValueError, match="at most"):
        About(meta={f"n{i}": "" for i in range(MOST_ENTRIES + 1)})


@pytest.mark.parametrize("name", ["", "1st", "a b", "a=b", "x" * 41, "é"])
def test_metadata_name_must_be_a_word(name: str) -> None:
    with pytest.raises(ValueError, match="is not a name"):
        About(meta={name: "v"})
