"""Helpers of several test folders: oracles, seeded cases and runners of commands."""
