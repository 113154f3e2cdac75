"""Checks the devices of a rig against each other: links, shared resources, interlocks."""
