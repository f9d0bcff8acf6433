"""What all formats share: which there are, many bags at once, staged folders, the dataset's card."""
