"""Many runs that can be compared: what is wanted, what flies it, what is kept, what it tells."""
