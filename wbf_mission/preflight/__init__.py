"""What would go wrong with a plan, found before it goes up: findings in a file, and in the vehicle."""
