"""Changes the code in small ways and looks whether the tests notice: mutation testing on cosmic-ray's operators."""
