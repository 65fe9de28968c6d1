"""Pages of live and finished runs, the studio, and the local web server."""
