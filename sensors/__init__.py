"""What there is to sense and what it tells: environment, camera, estimators, score."""
