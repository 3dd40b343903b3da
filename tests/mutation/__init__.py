"""Change one operation of the package at a time and measure how often a test fails."""
