"""The parts of the page, each with what it shows and what is done there."""
