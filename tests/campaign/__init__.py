"""Seeded campaigns of hostile files, tampered results and violations, run by `make campaign`."""
