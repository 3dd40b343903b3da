"""Ways to move a phase, one file each. `listed` gives the order in which they are tried."""
