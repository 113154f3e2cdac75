"""Defines the colours of a report; the style sheet of the page can replace them.

A figure is drawn with the light shades. In the page each of them becomes ``var(--name, #shade)``,
so that the style sheet, not the figure, decides the colour on a dark screen or on paper.
"""

from __future__ import annotations

from typing import Final

INK: Final = "#1c2024"
MUTED: Final = "#6b7178"
GRID: Final = "#e2e5e9"

#: Okabe and Ito's set, which stays apart for all common kinds of colour blindness; the yellow is
#: left out because it vanishes on white.
SERIES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
#: Measured against fitted: different in lightness as well as in hue.
MEASURED: Final = "#7d8b99"
FITTED: Final = "#c84e00"

#: shade in a figure -> (name of the style sheet's variable, shade on a dark screen)
VARIABLES: Final[dict[str, tuple[str, str]]] = {
    INK: ("ink", "#e8eaed"),
    MUTED: ("muted", "#a0a7b0"),
    GRID: ("grid", "#343a42"),
    MEASURED: ("measured", "#8595a5"),
    FITTED: ("fitted", "#ff9248"),
    **{
        light: (f"series-{i}", dark)
        for i, (light, dark) in enumerate(
            zip(
                SERIES,
                ("#4fb0ea", "#ff8b3d", "#2fcb9b", "#e6a2c8", "#f2b63c", "#8fd0f5"),
                strict=True,
            )
        )
    },
}


def series(index: int) -> str:
    """Return the colour of group ``index``; they repeat after six."""
    return SERIES[index % len(SERIES)]


def style_sheet_variables() -> str:
    """Return the CSS rules that define every shade, for light pages and dark screens."""
    light = "".join(f"--{name}:{shade};" for shade, (name, _) in VARIABLES.items())
    dark = "".join(f"--{name}:{shade};" for name, shade in VARIABLES.values())
    return f":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}"
