"""`quadctl lab`: a student's folder, its check, and the grading of a class."""
