"""Getting motion files from the site of those who captured them."""
