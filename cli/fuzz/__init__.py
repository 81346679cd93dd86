"""`quadctl fuzz`: what nobody may take."""
