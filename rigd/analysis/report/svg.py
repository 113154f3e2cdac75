"""Converts matplotlib figures to SVG for an HTML page: small, reproducible, in the page's colours.

A screen reader can read the drawings aloud. The module does not use pyplot and leaves matplotlib's
settings unchanged.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any, Final

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

from rigd.analysis.report.files import save
from rigd.analysis.report.palette import GRID, INK, MUTED, VARIABLES

# Any: releases of matplotlib differ in whether a setting is a str or a Literal to the checker.
_SETTINGS: Final[dict[Any, Any]] = {
    # Text stays text: searchable, read aloud, and set in the font of the page.
    "svg.fonttype": "none",
    "svg.hashsalt": "rigd",
    "pdf.fonttype": 42,  # TrueType: text that other programs can edit
    # Labels come from users: a dollar sign is a dollar sign, never mathematics.
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "font.family": ["DejaVu Sans"],
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 8.0,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 1.4,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.15,
    "axes.xmargin": 0.01,
}

#: 11 inches of figure fill the width of the page.
REM_PER_POINT: Final = 75.0 / (11.0 * 72.0)

_NO_METADATA: Final = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_PAINT: Final = re.compile(r"\b(fill|stroke): (#[0-9a-f]{6})")
_FRACTION: Final = re.compile(r"(-?\d+\.\d)\d+")
_IDENTIFIER: Final = re.compile(r' id="([^"]*)"')
_USED: Final = re.compile(r'(?:href="#|url\(#)([^")]+)')
_FAMILY: Final = re.compile(r"font-family: [^;\"]*;? ?")
_SHORTHAND: Final = re.compile(r"font: ([^;\"]*?)(\d+(?:\.\d+)?)px '[^;\"]*")
_NO_TURN: Final = re.compile(r' transform="rotate\(-?0 [^"]*"')
_VERTEX: Final = re.compile(r"([ML]) (-?[\d.]+ -?[\d.]+) \n")
_STYLE: Final = re.compile(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
_TAG: Final = re.compile(r"<[^>]*>")
_SPACE: Final = re.compile(r"\n\s*")
_OPENING: Final = re.compile(r'<svg\b[^>]*?viewBox="([^"]*)"[^>]*>')


@dataclass(frozen=True)
class Drawing:
    """A figure for the page: ``<svg>`` text, a description in words, and its caption."""

    svg: Markup
    alt: str
    caption: str


@contextmanager
def drawing_style() -> Iterator[None]:
    """Apply the report's matplotlib settings within the block, with any settings of the user."""
    with mpl.rc_context(), warnings.catch_warnings():
        # A script that the measuring font lacks is no fault: the reader's browser has the glyph.
        warnings.filterwarnings("ignore", message="Glyph .* missing from", category=UserWarning)
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def draw(figure: Figure, name: str, alt: str, caption: str = "") -> Drawing:
    """Return ``figure`` as a drawing; must be called within :func:`drawing_style`.

    Args:
        figure: what to draw; its size in inches gives the proportions only.
        name: unique in the page; the identifiers inside the SVG are derived from it.
        alt: one sentence on what the figure shows, for readers who do not see it.
        caption: printed beneath the figure.

    """
    save(figure, name, alt)
    text = StringIO()
    with mpl.rc_context({"svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata=_NO_METADATA)
    return Drawing(Markup(_for_page(text.getvalue(), alt)), alt, caption)


def _for_page(svg: str, alt: str) -> str:
    """Return matplotlib's SVG file as an element of an HTML page."""
    body = _STYLE.sub("", svg[svg.index("<svg") :], count=1)
    head = _OPENING.match(body)
    if head is None:
        raise ValueError("matplotlib wrote an SVG without a viewBox")
    body = body[head.end() :]
    used = set(_USED.findall(body))
    # Tag by tag: what stands between tags is a label, and labels are not ours to change.
    body = _TAG.sub(lambda tag: _lean(tag[0], used), body)
    # One scale for all figures of a page, so that their letters have one size.
    width = REM_PER_POINT * float(head[1].split()[2])
    opening = (
        f'<svg viewBox="{head[1]}" role="img" aria-label="{escape(alt)}" '
        f'style="max-width:{width:.1f}rem">'
    )
    return _SPACE.sub("\n", opening + body).strip()


def _lean(tag: str, used: set[str]) -> str:
    """Return one tag with the page's colours and font, and without what the page has no use for."""
    tag = _IDENTIFIER.sub(lambda m: m[0] if m[1] in used else "", tag)
    tag = _PAINT.sub(_themed, tag).replace("xlink:href", "href")
    # The page's own font, in both ways that versions of matplotlib name one.
    tag = _SHORTHAND.sub(r"font: \1\2px var(--font)", _FAMILY.sub("", tag))
    tag = _FRACTION.sub(r"\1", _NO_TURN.sub("", tag))
    return _VERTEX.sub(r"\1\2", tag)


def _themed(match: re.Match[str]) -> str:
    prop, shade = match[1], match[2]
    if shade not in VARIABLES:
        return f"{prop}: {shade}"
    return f"{prop}: var(--{VARIABLES[shade][0]})"
