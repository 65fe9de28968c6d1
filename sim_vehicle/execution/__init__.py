"""Mission items into flight: legs, sequence, execution, feasibility."""
