"""The index of DECISIONS.md lists each decision once, and marks at most 40 that bind."""

from __future__ import annotations

import re
from pathlib import Path

TEXT = (Path(__file__).parents[2] / "DECISIONS.md").read_text("utf-8")


def test_index_lists_each_decision_once() -> None:
    headings = re.findall(r"^## (\d+)\. (.+)$", TEXT, re.M)
    listed = re.findall(r"^- (\d+)\. \**\[(.+)\]\(#(.+?)\)", TEXT, re.M)
    assert sorted((number, title) for number, title, _ in listed) == sorted(headings)
    for number, title, anchor in listed:
        kept = re.sub(r"[^\w\- ]", "", f"{number}. {title}".lower())
        assert anchor == kept.replace(" ", "-")


def test_at_most_forty_decisions_bind() -> None:
    assert 0 < len(re.findall(r"^- \d+\. \*\*", TEXT, re.M)) <= 40
