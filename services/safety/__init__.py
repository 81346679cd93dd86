"""The safety automaton and its virtual cage."""
