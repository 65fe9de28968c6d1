"""How a field develops from day to day: epidemics and soil humidity as pure functions of state and chance."""
