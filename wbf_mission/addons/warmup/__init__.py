"""The command ``warm-up``: compiles everything once after an installation."""
