"""Recordings as an analysis takes them: signals at common times, corrected constants, no copies."""
