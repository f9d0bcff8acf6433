"""The effect of making way on the EMV, on each driver in its way, on the wake and on safety; from the record."""
