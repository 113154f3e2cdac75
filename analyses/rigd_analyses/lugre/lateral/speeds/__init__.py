"""Compares measured with modelled speeds of the carriage, beside those of the paper."""
