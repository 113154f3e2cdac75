"""Searches a folder of recordings by what stands in them, from an index that is made of the files.

The recordings alone are the data: the index can be deleted at any time, and is made again.
"""

from rigd.catalogue.catalogue import Broken, Found, search
from rigd.catalogue.facts import FIELDS, Listing
from rigd.catalogue.query import Condition, all_of, equal, parse_where, since

__all__ = [
    "FIELDS",
    "Broken",
    "Condition",
    "Found",
    "Listing",
    "all_of",
    "equal",
    "parse_where",
    "search",
    "since",
]
