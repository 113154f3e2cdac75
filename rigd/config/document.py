"""The reader of all YAML that rigd opens; it stands in the SDK, as plants have files too."""

from rigd.sdk.yaml.document import (
    MAX_BYTES,
    MAX_DEPTH,
    Data,
    Document,
    KeyPath,
    parse_document,
    read_document,
)

__all__ = [
    "MAX_BYTES",
    "MAX_DEPTH",
    "Data",
    "Document",
    "KeyPath",
    "parse_document",
    "read_document",
]
