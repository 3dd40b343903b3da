"""The tests of the package. The file README.md in this folder describes them."""
