"""Keeps what a daemon has beside its rig: logs, audit, certificates, trips, child processes."""
