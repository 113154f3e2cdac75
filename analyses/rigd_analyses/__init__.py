"""Contains the analyses that come with rigd; they compute friction with uncertainty."""
