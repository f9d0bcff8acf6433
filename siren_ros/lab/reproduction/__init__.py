"""Every measured figure, picture and film of the documents, made by commands and kept in one file of results."""
