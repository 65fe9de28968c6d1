"""The information model, and the score of an estimate."""
