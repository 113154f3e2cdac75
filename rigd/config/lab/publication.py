"""Checks what a publication of data states: authors, licence, publisher.

A lab states it in its file (``publication:`` of ``lab.yaml``), a person on the command line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import Field, StringConstraints

from rigd.config.document import Document
from rigd.config.problems import Problems
from rigd.config.source import Source

#: Licences for data by their SPDX identifier; any other one is stated by its address.
LICENSES: Final = {
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "CC-BY-SA-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "CC-BY-NC-4.0": "https://creativecommons.org/licenses/by-nc/4.0/",
    "CC-BY-NC-SA-4.0": "https://creativecommons.org/licenses/by-nc-sa/4.0/",
    "CC-BY-ND-4.0": "https://creativecommons.org/licenses/by-nd/4.0/",
    "ODbL-1.0": "https://opendatacommons.org/licenses/odbl/1-0/",
    "ODC-By-1.0": "https://opendatacommons.org/licenses/by/1-0/",
    "PDDL-1.0": "https://opendatacommons.org/licenses/pddl/1-0/",
}
_ORCID: Final = re.compile(r"(?:https?://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])")
_URL: Final = re.compile(r"https?://[^\s<>\"]+")
_DOI: Final = re.compile(r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}/[^\s\"<>]+)")
Words = Annotated[str, StringConstraints(min_length=1, max_length=2000)]


@dataclass(frozen=True)
class Author:
    """A person who is named as an author; ``orcid`` may be the identifier or its address."""

    name: str
    orcid: str = ""
    affiliation: str = ""

    def __post_init__(self) -> None:
        """Check the check digit of the ORCID iD (ISO 7064, mod 11-2).

        Raises:
            ValueError: it is wrong, or there is no name.
        """
        if not self.name.strip():
            raise ValueError("an author has no name")
        if not self.orcid:
            return
        match = _ORCID.fullmatch(self.orcid)
        if match is None:
            raise ValueError(
                f"{self.orcid!r} is no ORCID iD: four groups of four, as 0000-0002-1825-0097"
            )
        digits = match[1].replace("-", "")
        total = 0
        for digit in digits[:-1]:
            total = (total + int(digit)) * 2
        if "0123456789X"[(12 - total % 11) % 11] != digits[-1]:
            raise ValueError(f"the ORCID iD {match[1]} of {self.name} has a wrong check digit")

    @property
    def orcid_url(self) -> str:
        """The address of the ORCID iD; "" without one."""
        match = _ORCID.fullmatch(self.orcid)
        return f"https://orcid.org/{match[1]}" if match else ""


@dataclass(frozen=True)
class Publication:
    """What is stated of a data set as a whole; only the licence is needed."""

    license: str
    title: str = ""
    description: str = ""
    authors: tuple[Author, ...] = ()
    publisher: str = ""
    keywords: tuple[str, ...] = ()
    doi: str = ""

    def __post_init__(self) -> None:
        """Check licence and DOI.

        Raises:
            ValueError: the licence is neither known nor an address, or the DOI is none.
        """
        if self.license not in LICENSES and _URL.fullmatch(self.license) is None:
            raise ValueError(
                f"{self.license!r} is no licence that is known here: give one of "
                f"{', '.join(LICENSES)}, or the address of its text"
            )
        if self.doi:
            match = _DOI.fullmatch(self.doi)
            if match is None:
                raise ValueError(f"{self.doi!r} is no DOI, such as 10.5281/zenodo.1234567")
            object.__setattr__(self, "doi", f"https://doi.org/{match[1]}")

    @property
    def license_url(self) -> str:
        """The address of the licence."""
        return LICENSES.get(self.license, self.license)


def check_publication(document: Document, given: PublicationSource, problems: Problems) -> None:
    """Note what is wrong with the publication of a lab's file, at its place."""
    if given.license:
        try:
            Publication(given.license)
        except ValueError as error:
            problems.add(document.place(("publication", "license")), str(error))
    for number, author in enumerate(given.authors):
        try:
            author.author()
        except ValueError as error:
            key = "orcid" if author.orcid else "name"
            problems.add(document.place(("publication", "authors", number, key)), str(error))


class AuthorSource(Source):
    """A person whom the lab names as an author of its data."""

    name: Words
    """Name as it is printed."""
    orcid: Words | None = None
    """ORCID iD, such as 0000-0002-1825-0097."""
    affiliation: Words | None = None
    """Name of the institution."""

    def author(self) -> Author:
        """Return the author.

        Raises:
            ValueError: the ORCID iD is wrong.
        """
        return Author(self.name, self.orcid or "", self.affiliation or "")


class PublicationSource(Source):
    """What the lab states of data that it publishes."""

    license: Words | None = None
    """SPDX identifier, such as CC-BY-4.0, or the address of the licence."""
    publisher: Words | None = None
    """Who publishes the data: the institution, or the repository."""
    authors: Annotated[tuple[AuthorSource, ...], Field(max_length=100)] = ()
    """Authors, in the order in which they are named."""
    keywords: Annotated[tuple[Words, ...], Field(max_length=50)] = ()
    """Words by which the data are found."""
