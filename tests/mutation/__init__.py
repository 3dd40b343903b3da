"""A measured gate: change one operation of the package at a time and see whether a test fails."""
