"""Mistakes of authors that were written before the conformance suites were read.

They measure what ``check_driver``, ``check_plant`` and ``check_analysis`` find of mistakes that
nobody had in mind who wrote a rule. ``python benchmarks/conformance.py --fresh AUTHOR`` examines
those of one author. A mistake that they miss stays here as it is: a rule is made for its kind,
never for its text.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fresh:
    """One mistake: each text of ``edits`` stands once in ``file`` of the package."""

    name: str
    #: What the device, plant or result does wrong, for a person at the rig.
    harm: str
    #: Texts of the file as written, each with what stands in its place; CLS is the class's name.
    edits: tuple[tuple[str, str], ...]
    file: str = "driver"
    #: Why rigd lets a driver do so: then it is played, and not counted.
    allowed: str = ""

    def applied(self, text: str, class_name: str) -> str:
        """Return ``text``, of the package whose class is ``class_name``, with the mistake.

        Raises:
            ValueError: a text to replace is not there exactly once.
        """
        for edit in self.edits:
            old, new = (part.replace("CLS", class_name) for part in edit)
            if text.count(old) != 1:
                raise ValueError(f"{self.name}: {text.count(old)} times in the file: {old!r}")
            text = text.replace(old, new)
        return text
