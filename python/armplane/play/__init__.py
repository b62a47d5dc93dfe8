"""`armplane play`: a page in the browser on which a person takes the hand of an arm. Needs `pip install 'armplane[play]'`."""
