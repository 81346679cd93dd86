"""The impure part of dynamics: the compiled text, how it is made and how it is loaded."""
