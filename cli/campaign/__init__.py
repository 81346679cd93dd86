"""`quadctl campaign`: flights by the thousand."""
