"""Runs a procedure once: preflight, prompts, trials, result."""
