"""Networks and their fitting: the part of the training that needs torch, loaded by name when it is used."""
