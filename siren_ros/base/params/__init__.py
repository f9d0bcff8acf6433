"""Parameters and their files, plain files of users, and folders."""
