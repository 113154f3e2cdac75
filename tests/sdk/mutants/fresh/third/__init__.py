"""Mistakes of a third author, written without a look at the suites, the rules or other mistakes."""
