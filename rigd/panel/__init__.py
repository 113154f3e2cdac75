"""The operator's panel: a web page, served by a process that is a client of the daemon."""
