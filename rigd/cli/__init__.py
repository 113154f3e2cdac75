"""Contains the ``rigd`` commands: a short file for each, which is imported only when it runs."""
