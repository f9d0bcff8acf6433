"""Marks: one function for each number, of the EMV, of a driver, of the corridor, of the wake, of safety."""
