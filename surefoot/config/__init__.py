"""One configuration made of every part's own."""
