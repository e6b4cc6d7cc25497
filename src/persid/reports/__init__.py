"""What a run leaves: the folder of results, the page and its figures."""
