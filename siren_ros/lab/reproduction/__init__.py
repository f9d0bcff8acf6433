"""Makes all measured figures, pictures and films of the documents with commands; one file keeps the results."""
