"""Contains the analysis of a static friction law: force over speed."""
