"""Measures the effect of making way: on the EMV, on each driver in its way, on traffic behind it, and on safety."""
