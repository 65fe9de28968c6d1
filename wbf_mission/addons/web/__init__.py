"""The page that shows a run while it happens and afterwards, and its server on this machine."""
