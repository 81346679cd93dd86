"""Random flights by the thousand, on the automaton and the dynamics that fly live, and their score."""
