"""The ground station: it uploads a mission, arms, starts, changes it in flight, and follows until the end."""
