"""What is scored: the frames of recorded episodes, their labelled boxes, and the boxes that were found."""
