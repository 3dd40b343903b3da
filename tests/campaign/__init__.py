"""Seeded campaigns: hostile files, tampered results, seeded violations. `make campaign` runs all of
them.
"""
