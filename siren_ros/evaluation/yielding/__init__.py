"""What yielding was worth: marks of the EMV, of every driver in its way, of the wake and of safety; from the record."""
