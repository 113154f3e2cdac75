"""Tries an identified model on other recordings: does it predict what they measured?

:mod:`.saved` reads the model, :mod:`.result` holds what came out, :mod:`.evaluation` shows it.
"""
