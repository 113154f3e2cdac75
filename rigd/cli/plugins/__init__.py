"""Contains the commands that list and create plug-ins, rigs, schemas and completions."""
