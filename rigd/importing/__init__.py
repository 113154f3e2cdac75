"""Makes recordings of the data files of other programs, as a map describes them.

``rigd import`` uses :func:`load_map` and :func:`import_files`, ``rigd import --propose``
:func:`propose`.
"""

from rigd.importing.importer import Imported, import_files
from rigd.importing.map.map import ImportMap
from rigd.importing.map.map_reader import load_map, parse_map
from rigd.importing.proposal.proposal import Proposal, propose

__all__ = [
    "ImportMap",
    "Imported",
    "Proposal",
    "import_files",
    "load_map",
    "parse_map",
    "propose",
]
