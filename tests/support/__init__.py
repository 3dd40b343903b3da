"""Helpers that several rooms of tests share: oracles, seeded cases, and how a command is run."""
