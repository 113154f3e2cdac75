"""Rig files: YAML with positions to typed objects, errors as file:line:column."""
