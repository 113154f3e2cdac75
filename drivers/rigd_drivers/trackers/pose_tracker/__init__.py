"""Receives poses of bodies from a camera tracker, as JSON lines in UDP datagrams."""
