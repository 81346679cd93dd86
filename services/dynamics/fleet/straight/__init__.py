"""The model's text as a straight line of numpy calls that write where they are told.

program.py runs the text once on symbols, which write down each operation (symbols.py), puts what the
results need in an order (order.py), gives each a place for what it makes (registers.py), and has
the calls written as a function (emit.py). It changes which operations are done and when, never what
one makes, so that every bit stays.
"""
