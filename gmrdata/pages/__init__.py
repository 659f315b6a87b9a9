"""HTML pages and plots; the command line alone imports them."""
