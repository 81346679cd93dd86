"""The processes of the system; each sub-package is one, `runtime` is what they share."""
