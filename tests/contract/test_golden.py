"""How a text is compared with the one that is kept, on this arithmetic and on another."""

from __future__ import annotations

from pathlib import Path

import pytest
from contract.golden import same

KEPT = "mu_s 0.15060000 ± 0.0017, digest 0123456789abcdef\nfits\n"


def compared(folder: Path, text: str, *, exact: bool) -> None:
    new, old = folder / "new.txt", folder / "old.txt"
    new.write_text(text, "utf-8")
    old.write_text(KEPT, "utf-8")
    same(new, old, exact=exact)


def test_same_text_is_accepted(tmp_path: Path) -> None:
    compared(tmp_path, KEPT, exact=True)
    compared(tmp_path, KEPT, exact=False)


def test_other_arithmetic_may_move_last_digits(tmp_path: Path) -> None:
    moved = KEPT.replace("0.15060000", "0.15061").replace("abcdef", "abcdee")
    compared(tmp_path, moved, exact=False)
    with pytest.raises(AssertionError, match=r"old\.txt:1:"):
        compared(tmp_path, moved, exact=True)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("0.15060000", "0.15110000", r"old\.txt:1:"),
        ("mu_s", "mu_c", r"old\.txt:1:"),
        ("fits\n", "fits\nnearly\n", r"2 lines, now 3; the first more: nearly"),
        ("fits\n", "", r"2 lines, now 1; the first more: fits"),
    ],
)
def test_changed_text_is_refused_with_its_line(
    tmp_path: Path, exact: bool, old: str, new: str, named: str
) -> None:
    with pytest.raises(AssertionError, match=named):
        compared(tmp_path, KEPT.replace(old, new), exact=exact)


def test_other_arithmetic_changes_few_words(tmp_path: Path) -> None:
    new, old = tmp_path / "new.txt", tmp_path / "old.txt"
    old.write_text("fits\n" * 2000, "utf-8")
    new.write_text("fits\n" * 1998 + "fits nearly\n" * 2, "utf-8")
    same(new, old, exact=False)
    new.write_text("fits\n" * 1997 + "fits nearly\n" * 3, "utf-8")
    with pytest.raises(AssertionError, match=r"old\.txt:2000:"):
        same(new, old, exact=False)
