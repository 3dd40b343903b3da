"""Ways to move a phase, one file each. `listed` gives the order of suggestion."""
