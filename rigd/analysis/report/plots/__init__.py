"""The figures of a report: typed results in, matplotlib figures out."""
