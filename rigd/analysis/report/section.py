"""Defines the parts of a report beside the identification: references, labels, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigd.analysis.result import FloatArray, IdentificationResult


@dataclass(frozen=True, eq=False)
class ReferenceCurve:
    """A curve to draw beside the fitted one, in the units of the fitted one: (n,) ``x``, ``y``."""

    label: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True)
class ReportSection:
    """One group of the report, such as a floor: its result and the values to compare with.

    ``reference`` maps parameter names to values in the unit of the parameter; names that the
    result does not have are ignored, so that one table may serve several models.
    ``reference_label`` names the origin of the values.
    """

    label: str
    result: IdentificationResult
    reference: Mapping[str, float] = field(default_factory=dict)
    reference_label: str = "reference"
    reference_curve: ReferenceCurve | None = None


@dataclass(frozen=True)
class Facts:
    """A titled list of key and value, such as the metadata of one recording."""

    title: str
    entries: Mapping[str, str]


@dataclass(frozen=True)
class ReportAttachment:
    """A text that the report contains unchanged, such as the procedure file of a run."""

    name: str
    text: str


@dataclass(frozen=True)
class Opening:
    """The two sentences that a report opens with, without their first words.

    ``usable`` ends "Usable: …", ``not_usable`` ends "Not usable: …", with the reasons.
    """

    usable: str
    not_usable: str

    @property
    def sentences(self) -> tuple[str, str]:
        """Both, whole."""
        return f"Usable: {self.usable}", f"Not usable: {self.not_usable}"


@dataclass(frozen=True)
class Heading:
    """The lines under the title of a report.

    ``badge`` states that the data are simulated and how; it is empty for real devices. ``entries``
    are names and texts: rig, recordings, operator, dates. ``notes`` are what people wrote,
    ``losses`` what of the recordings is damaged or lost.
    """

    badge: str = ""
    entries: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()


@dataclass(frozen=True)
class Provenance:
    """The origin of the numbers, so that another person can repeat them.

    One :class:`Facts` for each recording (file name, sha256, run metadata) and one for the
    software; rig and procedure files as attachments. ``heading`` stands at the top of the page.
    """

    facts: tuple[Facts, ...] = ()
    attachments: tuple[ReportAttachment, ...] = ()
    heading: Heading = field(default_factory=Heading)
