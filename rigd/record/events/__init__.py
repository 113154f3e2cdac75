"""Holds what a recording has beside samples: events, trials, lost rows."""
