"""Logs users in to the panel, and keeps their sessions."""
