"""`armplane play`: a page on which a person takes the hand of an arm (extra `[play]`)."""
