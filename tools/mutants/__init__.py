"""Changes the code in small ways and looks whether the tests notice: mutation testing on cosmic-ray's operators.

cosmic-ray's own runner starts pytest anew for each change, works in the checkout itself and does not know which tests
run a line; it also makes four to five times as many changes, as it has no ``is_of_interest``. mutmut is quicker, but it
changes no decorated function, so no compiled loop, and cannot be told the changed lines.
"""
