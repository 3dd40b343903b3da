"""The tests; README.md beside this file maps them."""
